//! A field in one frame, fitted without the held-out positions and measured at them.

use nalgebra::Point3;

use super::placed::Placed;
use super::sweep::Position;
use super::{Error, FormKind, Options};
use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::fit::{Smoothness, fit};
use crate::color_field::frame::{Center, Frame};
use crate::color_field::frequency::{FrequencyForm, FrequencySettings};
use crate::color_field::grid::Grid;
use crate::color_field::hash::{HashForm, HashSettings};
use crate::color_field::validity::Validity;
use crate::color_field::{Form, Quality};
use crate::progress::Progress;
use nelu3d_field::device::Device;

/// Most coefficients of a field: 24 million in f16 are 48 MB.
const MAX_COEFFS: usize = 24_000_000;
/// Most cells along w in the light's frame, where only defocus changes.
const CELLS_ALONG_LIGHT: usize = 4;
/// Usable samples without which there is nothing to fit.
const MIN_SAMPLES: usize = 1000;

/// A field fitted without the held-out positions.
pub(super) struct Candidate {
    pub(super) frame: Frame,
    pub(super) center: Center,
    pub(super) cells: [usize; 3],
    /// Cells per pixel across.
    pub(super) fineness: usize,
    form: Form,
    /// All positions, for the final fit; none once another frame is tried, since two sets need not fit in memory.
    bins: Option<Bins>,
    pub(super) validity: Validity,
    pub(super) quality: Quality,
}

/// What one position leaves: its samples on their way to the bins, where they were, and how a field did there.
struct Passed {
    gathered: Gathered,
    validity: Validity,
    n: usize,
    errors: Errors,
}

impl Candidate {
    /// Fits a field in `frame` (whose box is still empty). Every position is read once: first those that are fitted,
    /// then the held-out ones, which are compared with the field and join the others in the bins.
    pub(super) fn new(
        placed: &Placed<'_>,
        mut frame: Frame,
        center: Center,
        fineness: usize,
        held: &[usize],
        opts: &Options,
        progress: &Progress,
    ) -> Result<Self, Error> {
        placed.for_each_point(|x| frame.enclose(x));
        // A hair of margin: the box was found from every seventh sample.
        for i in 0..3 {
            let margin = 0.01 * (frame.hi[i] - frame.lo[i]);
            frame.lo[i] -= margin;
            frame.hi[i] += margin;
        }
        let cells = resolution(placed, &frame, center, fineness);
        let mut validity = empty_validity(placed, cells);
        let mut bins = empty_bins(placed, cells, center, opts.form);
        let fitted: Vec<usize> = (0..placed.n_positions()).filter(|p| !held.contains(p)).collect();
        let mut usable = pass(placed, &frame, None, 0, &fitted, &mut bins, &mut validity, progress)?.0;
        // With so few that the held-out ones decide whether there are enough, they are looked at first.
        if usable < MIN_SAMPLES {
            let (mut bins, mut validity) = (empty_bins(placed, cells, center, opts.form), validity.clone());
            usable += pass(placed, &frame, None, 0, held, &mut bins, &mut validity, progress)?.0;
        }
        if usable < MIN_SAMPLES {
            return Err(Error::NoSamples {
                path: placed.sweep.folder(),
                reason: format!(
                    "no pixel of the board is usable in any position: white − black is below {:.0} % of full scale or an \
                     image is clipped everywhere; check exposure, `saturation` and `black_level`, and that white.png is \
                     the flash",
                    opts.min_contrast * 100.0
                ),
            });
        }
        let k = placed.sweep.k;
        let form = match opts.form {
            FormKind::Grid => {
                // Coarse to fine: the coarse fit fills what the fine one cannot see. It needs no more bins than it has
                // cells for.
                let few = [cells[0] / 4 + 1, cells[1] / 4 + 1];
                let coarse = bins.merged([few[0], few[1], bins.counts()[2]]);
                let mut grid = Grid::new([few[0], few[1], cells[2]], k);
                fit(&mut grid, &coarse, smoothness(center), 30, progress);
                let mut grid = grid.resampled(cells);
                fit(&mut grid, &bins, smoothness(center), 20, progress);
                Form::Grid(grid)
            }
            FormKind::Hash => {
                let mut hash = HashForm::new(HashSettings::for_cells(cells), k, opts.seed);
                hash.train(&bins, opts.seed, &Device::or_cpu(opts.device), progress);
                Form::Hash(Box::new(hash))
            }
            FormKind::Frequency => {
                let settings = FrequencySettings::for_cells(cells, opts.octaves);
                let mut frequency = FrequencyForm::new(settings, k, opts.seed);
                frequency.train(&bins, opts.seed, progress);
                Form::Frequency(Box::new(frequency))
            }
        };
        let grid = match &form {
            Form::Grid(g) => std::borrow::Cow::Borrowed(g),
            Form::Hash(h) => std::borrow::Cow::Owned(h.to_grid()),
            Form::Frequency(f) => std::borrow::Cow::Owned(f.to_grid()),
        };
        // Depth errors of every fourth sample at most, however many positions are held out.
        let stride = 4 * held.len().max(1);
        let (_, errors) = pass(placed, &frame, Some(&grid), stride, held, &mut bins, &mut validity, progress)?;
        drop(grid);
        validity.close();
        let quality = errors.quality(held.iter().map(|p| placed.sweep.shots[*p].name.clone()).collect());
        Ok(Self { frame, center, cells, fineness, form, bins: Some(bins), validity, quality })
    }

    /// Gives the bins' memory back, for another candidate's.
    pub(super) fn forget_bins(&mut self) {
        self.bins = None;
    }

    /// Fits the field to all positions, from where it is.
    pub(super) fn finish(&mut self, placed: &Placed<'_>, opts: &Options, progress: &Progress) -> Result<Form, Error> {
        let bins = match self.bins.take() {
            Some(bins) => bins,
            None => {
                let mut bins = empty_bins(placed, self.cells, self.center, opts.form);
                let mut validity = empty_validity(placed, self.cells);
                let all: Vec<usize> = (0..placed.n_positions()).collect();
                pass(placed, &self.frame, None, 0, &all, &mut bins, &mut validity, progress)?;
                bins
            }
        };
        let empty = Form::Grid(Grid::new([1, 1, 1], 1));
        let mut form = std::mem::replace(&mut self.form, empty);
        match &mut form {
            Form::Grid(grid) => fit(grid, &bins, smoothness(self.center), 8, progress),
            Form::Hash(hash) => {
                hash.train(&bins, opts.seed.wrapping_add(1), &Device::or_cpu(opts.device), progress);
            }
            Form::Frequency(frequency) => frequency.train(&bins, opts.seed.wrapping_add(1), progress),
        }
        Ok(form)
    }
}

fn smoothness(center: Center) -> Smoothness {
    match center {
        Center::Light => Smoothness { across: 3e-4, along: 3e-3 },
        Center::Camera => Smoothness { across: 3e-3, along: 1e-4 },
    }
}

/// Two bins a cell along w, and three along the light's rays for the forms with a network, which are no splines and lose by
/// less.
fn empty_bins(placed: &Placed<'_>, cells: [usize; 3], center: Center, form: FormKind) -> Bins {
    let along = match (center, form) {
        // However few positions there are: more must not take more memory.
        (Center::Light, FormKind::Grid) => CELLS_ALONG_LIGHT * 2,
        (Center::Light, FormKind::Hash | FormKind::Frequency) => CELLS_ALONG_LIGHT * 3,
        (Center::Camera, _) => cells[2] * 2,
    };
    Bins::new([cells[0], cells[1], along], placed.sweep.k)
}

/// Ranges along the rays of tiles of pixels, and lit cells of the frame.
fn empty_validity(placed: &Placed<'_>, cells: [usize; 3]) -> Validity {
    const TILE: usize = 8;
    let lit = [(cells[0] / 4).max(1), (cells[1] / 4).max(1), (placed.n_positions() / 2).clamp(1, 32)];
    Validity::new(placed.camera.width, placed.camera.height, TILE, lit)
}

/// Reads the positions `which` and adds them to bins and validity; with a `grid` they are compared with it first, every
/// `stride`th sample's depth error kept. Returns the number of usable samples.
fn pass(
    placed: &Placed<'_>,
    frame: &Frame,
    grid: Option<&Grid>,
    stride: usize,
    which: &[usize],
    bins: &mut Bins,
    validity: &mut Validity,
    progress: &Progress,
) -> Result<(usize, Errors), Error> {
    let blank = Validity::new(placed.camera.width, placed.camera.height, validity.shape.tile_px, validity.shape.cells);
    let gathered = bins.gathered();
    let map = |p: usize, (): (), position: &Position| {
        let mut out = Passed { gathered: gathered.clone(), validity: blank.clone(), n: 0, errors: Errors::default() };
        let width = placed.camera.width;
        placed.for_each(p, position, |i, t, v, w| {
            out.n += 1;
            if let Some(q) = frame.to_unit(&Point3::from(placed.dirs[i] * t)) {
                out.validity.add([(i % width) as f64, (i / width) as f64], t as f32, q);
                out.gathered.push(q, v, w);
            }
        });
        if let Some(grid) = grid {
            out.errors = Errors::of(placed, frame, grid, p, position, stride);
        }
        out
    };
    let (mut usable, mut errors) = (0, Errors::default());
    let take = |wave: Vec<Passed>| {
        let mut gathered = Vec::with_capacity(wave.len());
        for p in wave {
            usable += p.n;
            validity.merge(&p.validity);
            errors.merge(p.errors);
            gathered.push(p.gathered);
        }
        bins.add_all(&gathered);
    };
    placed.sweep.stream(which, progress, |(), _| {}, map, take)?;
    Ok((usable, errors))
}

/// Cells along a, b and w: across, `fineness` per pixel where the volume is; along, what the sweep can supervise.
fn resolution(placed: &Placed<'_>, frame: &Frame, center: Center, fineness: usize) -> [usize; 3] {
    let n_positions = placed.n_positions();
    let mid = Point3::from(placed.mean_point());
    // Pitch of samples at the middle of the volume, in the frame's units.
    let px = placed.camera.project(&mid).unwrap_or([placed.camera.cx, placed.camera.cy]);
    let at = |dx: f64, dy: f64| {
        let dir = placed.camera.ray([px[0] + dx, px[1] + dy]).dir;
        frame.to_abw(&Point3::from(dir * (mid.z / dir.z))).unwrap_or([0.0; 3])
    };
    let (o, r, d) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0));
    let pitch_a = (r[0] - o[0]).hypot(d[0] - o[0]).max(1e-9);
    let pitch_b = (r[1] - o[1]).hypot(d[1] - o[1]).max(1e-9);
    let span = |i: usize| frame.hi[i] - frame.lo[i];
    let along = match center {
        // Only defocus changes along a ray of light.
        Center::Light => (n_positions / 4).clamp(1, CELLS_ALONG_LIGHT),
        Center::Camera => n_positions - 1,
    };
    let mut cells =
        [(span(0) / pitch_a).ceil() as usize * fineness, (span(1) / pitch_b).ceil() as usize * fineness, along];
    let nodes = |c: [usize; 3]| c.iter().map(|c| c + 3).product::<usize>() * placed.sweep.k;
    let shrink = (MAX_COEFFS as f64 / nodes(cells) as f64).sqrt().min(1.0);
    for c in &mut cells[..2] {
        *c = ((*c as f64 * shrink) as usize).max(4);
    }
    cells
}

/// The contrast (white − black) from which a sample is well lit: a tenth of full scale, or half of what the best tenth of
/// the position's samples have where the exposure is short. Black ink is below it.
fn well_lit(contrast: &[f32]) -> f32 {
    let mut usable: Vec<f32> = contrast.iter().copied().filter(|c| *c > 0.0).collect();
    if usable.is_empty() {
        return 0.1;
    }
    let at = usable.len() * 9 / 10;
    let (_, bright, _) = usable.select_nth_unstable_by(at, f32::total_cmp);
    (0.5 * *bright).min(0.1)
}

/// Sums of a field's errors at positions that it was not made from.
#[derive(Default)]
struct Errors {
    /// Squared errors and their number, over every usable sample.
    all: (f64, usize),
    /// The same over well-lit ones.
    lit: (f64, usize),
    /// Variance that noise alone gives the well-lit ones.
    noise: f64,
    /// Depth errors of a selection, mm.
    depth: Vec<f32>,
}

impl Errors {
    fn of(placed: &Placed<'_>, frame: &Frame, grid: &Grid, p: usize, position: &Position, stride: usize) -> Self {
        let (k, channels) = (placed.sweep.k, placed.sweep.channels);
        let mut s = Self::default();
        let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
        let mut n = 0usize;
        let lit = well_lit(&position.contrast);
        placed.for_each(p, position, |i, t, v, w| {
            n += 1;
            let m = frame.along_ray(&placed.dirs[i]).at(t);
            let with_depth = n.is_multiple_of(stride);
            if with_depth {
                grid.eval_along(m.q, m.dq, &mut c, &mut d);
            } else {
                grid.eval(m.q, &mut c);
            }
            let (mut h, mut g) = (0.0, 0.0);
            for j in 0..k {
                if w[j] == 0.0 {
                    continue;
                }
                let e = c[j] - v[j];
                s.all.0 += f64::from(e * e);
                s.all.1 += 1;
                if position.contrast[i * channels + j % channels] >= lit {
                    s.lit.0 += f64::from(e * e);
                    s.lit.1 += 1;
                    s.noise += f64::from(1.0 / w[j]);
                }
                h += w[j] * d[j] * d[j];
                g += w[j] * d[j] * e;
            }
            if with_depth && h > 0.0 {
                s.depth.push((g / h).abs());
            }
        });
        s
    }

    fn merge(&mut self, s: Self) {
        self.all = (self.all.0 + s.all.0, self.all.1 + s.all.1);
        self.lit = (self.lit.0 + s.lit.0, self.lit.1 + s.lit.1);
        self.noise += s.noise;
        self.depth.extend(s.depth);
    }

    fn quality(mut self, held_out: Vec<String>) -> Quality {
        let db = |sum: f64, n: usize| if n > 0 { -10.0 * (sum / n as f64).log10() } else { f64::NAN };
        self.depth.sort_by(f32::total_cmp);
        let (lit, noise) = if self.lit.1 > 0 {
            (db(self.lit.0, self.lit.1), db(self.noise, self.lit.1))
        } else {
            (db(self.all.0, self.all.1), 60.0)
        };
        Quality {
            held_out,
            n: self.all.1,
            psnr_db: lit,
            psnr_all_db: db(self.all.0, self.all.1),
            ceiling_db: noise,
            depth_mm: self.depth.get(self.depth.len() / 2).copied().unwrap_or(f32::NAN).into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn well_lit_follows_the_exposure_but_not_the_ink() {
        // A third ink of a twentieth of the paper's albedo; a few highlights; unusable pixels.
        let board = |paper: f32| -> Vec<f32> {
            let kinds = [paper, paper, 0.05 * paper, 0.0];
            let mut all: Vec<f32> = (0..4000).map(|i| kinds[i % 4]).collect();
            all[..20].fill(0.9);
            all
        };
        for paper in [0.8f32, 0.3, 0.08, 0.03] {
            let limit = well_lit(&board(paper));
            assert!(limit <= 0.1 && limit > 0.05 * paper && limit < paper, "{paper}: {limit}");
        }
        assert_eq!(well_lit(&board(0.8)), 0.1);
    }
}
