//! A selection of a sweep's positions, evenly spread and of bounded size: what the sensor's noise and the light's
//! center are estimated from.

use nalgebra::Vector3;
use nelu3d_scan::{Camera, Image, Rig};
use rayon::prelude::*;

use super::drawn::{self, Drawn};
use super::error::CalibrationError;
use super::held_out::well_lit;
use super::judge::Fingerprint;
use super::placed_sweep::{BoardPlane, PlacedSweep};
use super::sweep::Position;
use crate::progress::Progress;
use crate::sensor::{NoiseEstimator, darkest_intensity, quantization_step};

/// Most positions that the search looks at. They are spread over the whole sweep, so more would only add shorter steps
/// to the lever arms.
pub const MAX_VIEWS: usize = 48;
/// Most bytes of their images; larger ones are averaged over square blocks of pixels.
pub const VIEWS_BUDGET: usize = 1 << 28;
/// Validity of a sample of which more than half was usable.
const MOSTLY: f32 = 0.51;
/// Fewest samples along the shorter side of a level.
const MIN_SIDE: usize = 12;

/// Indices of the positions that the search looks at, of `n`: all of them, or an even selection with both ends.
pub fn selection(n: usize) -> Vec<usize> {
    if n <= MAX_VIEWS { (0..n).collect() } else { (0..MAX_VIEWS).map(|i| i * (n - 1) / (MAX_VIEWS - 1)).collect() }
}

/// Codeword images of some positions, in the order of their depth, in levels of resolution, and where their boards are.
pub struct Views {
    /// Number of pattern channels.
    pub k: usize,
    /// Which position of the sweep each view is.
    pub positions: Vec<usize>,
    /// Normal and offset of each view's board.
    pub planes: Vec<(Vector3<f64>, f64)>,
    /// The finest first; each of the others has half the resolution of the one before.
    pub levels: Vec<Level>,
}

/// The codeword images of all views at one resolution.
pub struct Level {
    /// Samples across.
    pub width: usize,
    /// Samples down.
    pub height: usize,
    /// Pixels along the side of one sample's block; 1 = full resolution.
    pub block: usize,
    /// Validity from which a sample may be used.
    pub(super) min_validity: f32,
    /// Per view, `n × (k + 1)`: values, then validity (the part of the sample that was usable).
    pub images: Vec<Vec<f32>>,
}

impl Level {
    /// An empty level for blocks that keep the images of `n` positions of `k` channels within their budget.
    pub fn finest(camera: &Camera, k: usize, n: usize) -> Self {
        let bytes = camera.n_pixels() * (k + 1) * 4 * n;
        let block = (1..).find(|f| bytes / (f * f) <= VIEWS_BUDGET).expect("some block is large enough");
        let (width, height) = (camera.width / block, camera.height / block);
        Self { width, height, block, min_validity: 0.99, images: Vec::new() }
    }

    /// Lets samples be used whose surroundings are usable in part, where hardly any are wholly: on a print whose details
    /// are as fine as the kernel, ink is near everywhere.
    fn relax(&mut self, k: usize) {
        /// Part of the samples whose surroundings are mostly usable that has to be wholly so.
        const ENOUGH: f64 = 0.1;
        let beyond =
            |least: f32| self.images.iter().flat_map(|i| i.chunks_exact(k + 1)).filter(|s| s[k] >= least).count();
        tracing::debug!(wholly = beyond(self.min_validity), mostly = beyond(MOSTLY), "usable samples");
        if (beyond(self.min_validity) as f64) < ENOUGH * beyond(MOSTLY) as f64 {
            self.min_validity = MOSTLY;
        }
    }

    /// Pixel coordinates of the center of a sample's block.
    pub(super) fn px(&self, x: usize, y: usize) -> [f64; 2] {
        let half = (self.block as f64 - 1.0) / 2.0;
        [(x * self.block) as f64 + half, (y * self.block) as f64 + half]
    }

    /// The level of half the resolution: means over 2 × 2 samples, weighted by validity.
    fn halved(&self, k: usize) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let halve = |from: &Vec<f32>| {
            let mut image = Vec::with_capacity(width * height * (k + 1));
            let mut mean = vec![0.0f32; k + 1];
            for i in 0..width * height {
                let to = &mut mean[..];
                to.fill(0.0);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = (2 * (i % width) + dx, 2 * (i / width) + dy);
                    let sample = &from[(y * self.width + x) * (k + 1)..][..k + 1];
                    // Below, values are sums of what little there was.
                    if sample[k] > 0.5 {
                        to[..k].iter_mut().zip(sample).for_each(|(t, s)| *t += sample[k] * s);
                        to[k] += sample[k];
                    }
                }
                if to[k] > 0.0 {
                    let norm = 1.0 / to[k];
                    to[..k].iter_mut().for_each(|t| *t *= norm);
                    to[k] *= 0.25;
                }
                image.extend_from_slice(to);
            }
            image
        };
        let images = self.images.par_iter().map(halve).collect();
        Self { width, height, block: self.block * 2, min_validity: MOSTLY, images }
    }
}

impl Views {
    /// Orders the views by the depth of their boards along `middle`, and adds the coarser levels.
    pub fn new(k: usize, boards: Vec<(usize, BoardPlane)>, mut finest: Level, middle: &Vector3<f64>) -> Self {
        let depth = |b: &BoardPlane| b.offset / b.normal.dot(middle);
        let mut order: Vec<usize> = (0..boards.len()).collect();
        order.sort_by(|a, b| depth(&boards[*a].1).total_cmp(&depth(&boards[*b].1)));
        let images = order.iter().map(|i| std::mem::take(&mut finest.images[*i])).collect();
        finest.images = images;
        finest.relax(k);
        let mut levels = vec![finest];
        while let Some(last) = levels.last().filter(|l| l.width.min(l.height) >= 2 * MIN_SIDE) {
            levels.push(last.halved(k));
        }
        let positions = order.iter().map(|i| boards[*i].0).collect();
        let planes = order.iter().map(|i| (boards[*i].1.normal, boards[*i].1.offset)).collect();
        Self { k, positions, planes, levels }
    }

    /// Returns the number of views.
    pub fn count(&self) -> usize {
        self.positions.len()
    }

    /// Drops the views for which `keep` is false.
    pub(super) fn retain(&mut self, keep: &[bool]) {
        fn retained<T>(v: &mut Vec<T>, keep: &[bool]) {
            let mut keep = keep.iter();
            v.retain(|_| *keep.next().expect("one answer per view"));
        }
        retained(&mut self.positions, keep);
        retained(&mut self.planes, keep);
        self.levels.iter_mut().for_each(|l| retained(&mut l.images, keep));
    }
}

/// Reads a selection of positions: sets the sensor's noise of `placed` and what its positions are judged by, and with
/// `keep` returns the views that the light's center is found from.
pub(super) fn estimate_noise(
    placed: &mut PlacedSweep<'_>,
    rig: &Rig,
    keep: bool,
    progress: &Progress,
) -> Result<Option<Views>, CalibrationError> {
    let n = placed.n_positions();
    let (of_views, judged) = (selection(n), drawn::selection(n));
    let which: Vec<usize> = (0..n).filter(|p| of_views.contains(p) || judged.contains(p)).collect();
    let (k, channels) = (placed.sweep.k, placed.sweep.channels);
    let mut finest = keep.then(|| Level::finest(&placed.camera, k, of_views.len()));
    let mut placed_at = Vec::new();
    let block = finest.as_ref().map(|v| v.block);
    let (boards, dirs) = (&placed.boards, &placed.dirs);
    let (mut noise, mut kept) = (NoiseEstimator::default(), Vec::new());
    let n_images = which.len() * placed.sweep.n_images();
    let darkest = darkest_intensity(rig.black_level, rig.saturation);
    let gather = |(noise, fingerprint): &mut (NoiseEstimator, Fingerprint), image: &Image| {
        noise.add_one_of(n_images, image);
        fingerprint.add(image);
    };
    let map = |p: usize, (noise, fingerprint): (NoiseEstimator, Fingerprint), position: &Position| {
        debug_assert_eq!(position.channels, channels);
        // Beside the board there is a room that stands still: it would tell of a light in the camera.
        let on_board = |i: usize| boards[p].hit(&dirs[i]).is_some();
        let block = block.filter(|_| of_views.contains(&p));
        let view = block.map(|block| (p, boards[p], smoothed(position, on_board, block)));
        let lit = well_lit(&position.contrast);
        let drawn = judged.contains(&p).then(|| (p, Drawn::of(position, fingerprint, lit, judged.len())));
        (noise, drawn, view)
    };
    let take = |wave: Vec<_>| {
        for (n, drawn, view) in wave {
            noise.merge(&n);
            kept.extend(drawn);
            if let (Some(finest), Some((p, board, image))) = (&mut finest, view) {
                placed_at.push((p, board));
                finest.images.push(image);
            }
        }
    };
    placed.sweep.stream(&which, progress, gather, map, take)?;
    kept.into_iter().for_each(|(p, drawn)| placed.keep_drawn(p, drawn));
    let step = quantization_step(rig.black_level, rig.saturation);
    let pixels = placed.sweep.binning.pow(2);
    let of_pixels = noise.finish(step, Some(darkest));
    (placed.noise, placed.noise_growth) = (of_pixels.of_mean(pixels), noise.growth(step));
    placed.sweep.noise = Some(placed.noise);
    let middle = placed.mean_point().normalize();
    Ok(finest.map(|finest| Views::new(k, placed_at, finest, &middle)))
}

/// A position's values where `keep` holds for its pixels, averaged over blocks of `block` pixels and smoothed by a
/// small binomial kernel (linear interpolation between pixels is exact enough on the result), with validity 1 where the
/// whole kernel was usable: `n × (k + 1)`. Ink is not: it reflects too little to tell its codeword.
pub fn smoothed(position: &Position, keep: impl Fn(usize) -> bool, block: usize) -> Vec<f32> {
    let channels = position.channels;
    let mut contrast = position.contrast.clone();
    for (i, contrast) in contrast.chunks_exact_mut(channels).enumerate() {
        if contrast.iter().any(|c| *c > 0.0) && !keep(i) {
            contrast.fill(0.0);
        }
    }
    let reduced = (block > 1).then(|| position.reduced_by(&contrast, block));
    let (position, contrast) = reduced.as_ref().map_or((position, &contrast), |reduced| (reduced, &reduced.contrast));
    let (w, h, k) = (position.width, position.height, position.k);
    let lit = 0.5 * well_lit(contrast);
    let usable = |i: usize| contrast[i * channels..][..channels].iter().all(|c| *c > lit);
    const KERNEL: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
    // Along a row and then down, as sums of shifted rows: of the first, only those that the second needs are kept.
    let line = w * (k + 1);
    let mut masked = vec![0.0f32; line];
    let mut along: [Vec<f32>; KERNEL.len()] = std::array::from_fn(|_| vec![0.0; line]);
    let mut out: Vec<f32> = Vec::with_capacity(h * line);
    for y in 0..h {
        if w >= KERNEL.len() {
            // What is not usable counts nothing.
            masked.fill(0.0);
            for (x, masked) in masked.chunks_exact_mut(k + 1).enumerate().filter(|(x, _)| usable(y * w + x)) {
                masked[..k].copy_from_slice(&position.values[(y * w + x) * k..][..k]);
                masked[k] = 1.0;
            }
            let inner = line - 4 * (k + 1);
            let to = &mut along[y % KERNEL.len()][2 * (k + 1)..][..inner];
            weighed_sum(to, std::array::from_fn(|i| &masked[i * (k + 1)..][..inner]), &KERNEL);
        }
        // The first rows and the last have no whole kernel.
        if y < KERNEL.len() - 1 {
            continue;
        }
        out.resize((y - 1) * line, 0.0);
        let to = &mut out[(y - 2) * line..];
        weighed_sum(to, std::array::from_fn(|i| &along[(y + 1 + i) % KERNEL.len()][..]), &KERNEL);
        for t in to.chunks_exact_mut(k + 1).filter(|t| t[k] > 0.5) {
            let norm = 1.0 / t[k];
            t[..k].iter_mut().for_each(|v| *v *= norm);
        }
    }
    out.resize(h * line, 0.0);
    out
}

/// Writes the sum of five slices, weighed.
fn weighed_sum(to: &mut [f32], [a, b, c, d, e]: [&[f32]; 5], weights: &[f32; 5]) {
    for ((((to, a), b), c), (d, e)) in to.iter_mut().zip(a).zip(b).zip(c).zip(d.iter().zip(e)) {
        *to = weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d + weights[4] * e;
    }
}
