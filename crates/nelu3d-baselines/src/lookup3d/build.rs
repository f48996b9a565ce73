//! From a sweep to a table, position by position: besides the table, no more than a few positions' images are in
//! memory.

use nelu3d_scan::Rig;
use nelu3d_scan::rig::PatternSet;
use rayon::prelude::*;

use super::error::LookupTableError;
use super::file::MAX_STRIDE;
use super::full::FullTable;
use super::shape::{TableShape, free_memory};
use nelu3d::calibrate::{
    CalibrationError, CalibrationOptions, PlacedSweep, Position, SweepGeometry, solve_board_poses,
};
use nelu3d::progress::Progress;
use nelu3d::progress::StageClock;
use nelu3d::sensor::DarkLevel;
use nelu3d::sensor::{NoiseEstimator, NoiseModel, quantization_step};

/// A table and what the sweep told of the sensor on the way.
#[derive(Clone, Debug)]
pub struct BuiltTable {
    /// The table.
    pub table: FullTable,
    /// The sensor's noise.
    pub noise: NoiseModel,
    /// What is seen without the light source, per channel.
    pub dark: Vec<DarkLevel>,
}

/// Share of the free memory that a table may take.
const MAX_SHARE_OF_FREE: f64 = 0.8;

/// Builds the table of a rig's sweep for one pattern set, of every `step`th pixel. Positions are put in order of their
/// depth in the middle of the volume, so that neighbors in the table are neighbors in space.
///
/// # Errors
///
/// The sweep cannot be used, or the table does not fit in memory.
pub fn build(
    rig: &Rig,
    set: &PatternSet,
    step: usize,
    opts: &CalibrationOptions,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<BuiltTable, LookupTableError> {
    check_memory(rig, set, step)?;
    let SweepGeometry { placed, dark, .. } = solve_board_poses(rig, set, opts, progress, clock)?;

    clock.begin("build the lookup table");
    let (w, h, k) = (rig.camera.width, rig.camera.height, rig.channels_of(set));
    let shape = TableShape::of_picture(w, h, step, placed.n_positions(), k);
    let mut table = FullTable::empty(shape);
    let rank = ranks_by_depth(&placed);
    let mut noise = NoiseEstimator::default();
    let mut lit = LitEntries::default();
    let map = |p: usize, noise: NoiseEstimator, position: &Position| {
        let (column, lit) = column_of(&placed, &shape, p, position);
        (p, noise, lit, column)
    };
    let take = |wave: Vec<(usize, NoiseEstimator, LitEntries, Vec<f32>)>| {
        for (p, n, l, column) in wave {
            noise.merge(&n);
            lit.merge(&l);
            table.set_column(rank[p], 0, &column);
        }
    };
    let all: Vec<usize> = (0..placed.n_positions()).collect();
    placed.sweep.stream(&all, progress, NoiseEstimator::add, map, take)?;
    let noise = noise.finish(quantization_step(rig.black_level, rig.saturation), None);
    table.variance = lit.variance(&noise);
    let found = (0..shape.n_pixels()).into_par_iter().any(|i| table.channel(i, 0).iter().any(|v| !v.is_nan()));
    if !found {
        let reason = "no pixel of the board is usable in any position: its images are clipped or too dark; check the \
                      exposure, `saturation` and `black_level`";
        return Err(CalibrationError::NoSamples { path: placed.sweep.folder(), reason: reason.into() }.into());
    }
    Ok(BuiltTable { table, noise, dark })
}

/// Checks the stride, and from the number of folders, before the work, that the table will fit in memory.
fn check_memory(rig: &Rig, set: &PatternSet, step: usize) -> Result<(), LookupTableError> {
    let (w, h) = (rig.camera.width, rig.camera.height);
    if step == 0 || step > MAX_STRIDE.min(w.min(h) - 1) {
        return Err(LookupTableError::Stride(step));
    }
    let k = rig.channels_of(set);
    let n_folders = rig.positions().map_err(CalibrationError::from)?.len();
    let needed = |step| TableShape::of_picture(w, h, step, n_folders, k).bytes() as f64;
    if let Some(free) = free_memory().map(|free| free * MAX_SHARE_OF_FREE)
        && needed(step) > free
    {
        let mb = |bytes: f64| (bytes / 1e6).round() as u64;
        let fits = (step + 1..=MAX_STRIDE).find(|s| needed(*s) <= free).unwrap_or(MAX_STRIDE);
        return Err(LookupTableError::Memory { needed_mb: mb(needed(step)), available_mb: mb(free), stride: fits });
    }
    Ok(())
}

/// Returns the rank of every board position by its depth in the middle of the volume.
fn ranks_by_depth(placed: &PlacedSweep<'_>) -> Vec<usize> {
    let middle = placed.mean_point().normalize();
    let along = |p: usize| placed.boards[p].offset / placed.boards[p].normal.dot(&middle);
    let mut order: Vec<usize> = (0..placed.n_positions()).collect();
    order.sort_by(|a, b| along(*a).total_cmp(&along(*b)));
    let mut rank = vec![0; order.len()];
    order.iter().enumerate().for_each(|(i, p)| rank[*p] = i);
    rank
}

/// Returns the samples of one board position, `[pixel][k + 1]`, and what its well-lit entries say of their variance.
fn column_of(placed: &PlacedSweep<'_>, shape: &TableShape, p: usize, position: &Position) -> (Vec<f32>, LitEntries) {
    let (board, k) = (&placed.boards[p], shape.k);
    let mut column = vec![f32::NAN; shape.n_pixels() * (k + 1)];
    let mut lit = LitEntries::default();
    for (i, sample) in column.chunks_exact_mut(k + 1).enumerate() {
        let (x, y) = (i % shape.width * shape.step, i / shape.width * shape.step);
        let pixel = y * position.width + x;
        let dir = &placed.dirs[pixel];
        let hit = board.hit(dir);
        let t = hit.unwrap_or(board.offset / board.normal.dot(dir));
        if t.is_finite() && t > 0.0 {
            sample[k] = (t * dir.z) as f32;
        }
        let contrast = &position.contrast[pixel * position.channels..][..position.channels];
        if hit.is_none() || contrast.iter().any(|c| *c <= 0.0) {
            continue;
        }
        sample[..k].copy_from_slice(&position.values[pixel * k..][..k]);
        for (j, l) in sample[..k].iter().enumerate() {
            lit.add(*l, contrast[j % position.channels]);
        }
    }
    (column, lit)
}

/// Sums over the well-lit entries of a table. The variance of a normalized intensity is linear in the noise model; the
/// sums are those of its factors.
#[derive(Clone, Copy, Default)]
struct LitEntries {
    n: f64,
    read: f64,
    gain: f64,
}

impl LitEntries {
    /// Adds an entry of normalized intensity `l`, if its contrast is good.
    fn add(&mut self, l: f32, contrast: f32) {
        if contrast >= 0.1 {
            self.n += 1.0;
            self.read +=
                f64::from(NoiseModel { read: 1.0, gain: 0.0, darkest: None }.normalized_variance(l, contrast, 0.0));
            self.gain +=
                f64::from(NoiseModel { read: 0.0, gain: 1.0, darkest: None }.normalized_variance(l, contrast, 0.0));
        }
    }

    /// Adds the sums of another position.
    fn merge(&mut self, other: &Self) {
        self.n += other.n;
        self.read += other.read;
        self.gain += other.gain;
    }

    /// Returns the mean variance of an entry; 0 if there is none.
    fn variance(&self, noise: &NoiseModel) -> f32 {
        if self.n > 0.0 {
            ((f64::from(noise.read) * self.read + f64::from(noise.gain) * self.gain) / self.n) as f32
        } else {
            0.0
        }
    }
}
