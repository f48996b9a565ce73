//! A field in one frame, fitted without the held-out positions and measured at them.

use nalgebra::Point3;

use super::error::CalibrationError;
use super::held_out::HeldOutErrors;
use super::options::{CalibrationOptions, FormKind};
use super::placed_sweep::PlacedSweep;
use super::sweep::Position;
use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::fit::{Smoothness, fit};
use crate::color_field::frame::{Center, FieldFrame};
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

/// What every fit of a calibration needs.
#[derive(Clone, Copy)]
pub(super) struct FitContext<'a, 'r> {
    pub(super) placed: &'a PlacedSweep<'r>,
    pub(super) opts: &'a CalibrationOptions,
    /// Where networks are trained.
    pub(super) device: &'a Device,
    pub(super) progress: &'a Progress,
}

/// A field fitted without the held-out positions.
pub(super) struct Candidate {
    pub(super) frame: FieldFrame,
    pub(super) center: Center,
    pub(super) cells: [usize; 3],
    /// Cells per pixel across.
    pub(super) cells_per_pixel: usize,
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
    errors: HeldOutErrors,
}

impl Candidate {
    /// Fits a field in `frame` (whose box is still empty). Every position is read once: first those that are fitted,
    /// then the held-out ones, which are compared with the field and join the others in the bins.
    pub(super) fn fit(
        cx: &FitContext<'_, '_>,
        mut frame: FieldFrame,
        center: Center,
        cells_per_pixel: usize,
        held: &[usize],
    ) -> Result<Self, CalibrationError> {
        let FitContext { placed, opts, progress, .. } = *cx;
        placed.for_each_point(|x| frame.enclose(x));
        // A hair of margin: the box was found from every seventh sample.
        for i in 0..3 {
            let margin = 0.01 * (frame.hi[i] - frame.lo[i]);
            frame.lo[i] -= margin;
            frame.hi[i] += margin;
        }
        let cells = resolution(placed, &frame, center, cells_per_pixel);
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
            return Err(CalibrationError::NoSamples {
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
                hash.train(&bins, opts.seed, cx.device, progress);
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
        Ok(Self { frame, center, cells, cells_per_pixel, form, bins: Some(bins), validity, quality })
    }

    /// Frees the bins' memory for another candidate's.
    pub(super) fn drop_bins(&mut self) {
        self.bins = None;
    }

    /// Fits the field to all positions, from where it is.
    pub(super) fn fit_all_positions(&mut self, cx: &FitContext<'_, '_>) -> Result<Form, CalibrationError> {
        let FitContext { placed, opts, progress, .. } = *cx;
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
                hash.train(&bins, opts.seed.wrapping_add(1), cx.device, progress);
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
fn empty_bins(placed: &PlacedSweep<'_>, cells: [usize; 3], center: Center, form: FormKind) -> Bins {
    let along = match (center, form) {
        // However few positions there are: more must not take more memory.
        (Center::Light, FormKind::Grid) => CELLS_ALONG_LIGHT * 2,
        (Center::Light, FormKind::Hash | FormKind::Frequency) => CELLS_ALONG_LIGHT * 3,
        (Center::Camera, _) => cells[2] * 2,
    };
    Bins::new([cells[0], cells[1], along], placed.sweep.k)
}

/// Ranges along the rays of tiles of pixels, and lit cells of the frame.
fn empty_validity(placed: &PlacedSweep<'_>, cells: [usize; 3]) -> Validity {
    const TILE: usize = 8;
    let lit = [(cells[0] / 4).max(1), (cells[1] / 4).max(1), (placed.n_positions() / 2).clamp(1, 32)];
    Validity::new(placed.camera.width, placed.camera.height, TILE, lit)
}

/// Reads the positions `which` and adds them to bins and validity; with a `grid` they are compared with it first, every
/// `stride`th sample's depth error kept. Returns the number of usable samples.
fn pass(
    placed: &PlacedSweep<'_>,
    frame: &FieldFrame,
    grid: Option<&Grid>,
    stride: usize,
    which: &[usize],
    bins: &mut Bins,
    validity: &mut Validity,
    progress: &Progress,
) -> Result<(usize, HeldOutErrors), CalibrationError> {
    let blank = Validity::new(placed.camera.width, placed.camera.height, validity.shape.tile_px, validity.shape.cells);
    let gathered = bins.gathered();
    let map = |p: usize, (): (), position: &Position| {
        let mut out =
            Passed { gathered: gathered.clone(), validity: blank.clone(), n: 0, errors: HeldOutErrors::default() };
        let width = placed.camera.width;
        placed.for_each(p, position, |i, t, v, w| {
            out.n += 1;
            if let Some(q) = frame.to_unit(&Point3::from(placed.dirs[i] * t)) {
                out.validity.add([(i % width) as f64, (i / width) as f64], t as f32, q);
                out.gathered.push(q, v, w);
            }
        });
        if let Some(grid) = grid {
            out.errors = HeldOutErrors::of(placed, frame, grid, p, position, stride);
        }
        out
    };
    let (mut usable, mut errors) = (0, HeldOutErrors::default());
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

/// Cells along a, b and w: across, `cells_per_pixel` per pixel where the volume is; along, what the sweep can supervise.
fn resolution(placed: &PlacedSweep<'_>, frame: &FieldFrame, center: Center, cells_per_pixel: usize) -> [usize; 3] {
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
    let mut cells = [
        (span(0) / pitch_a).ceil() as usize * cells_per_pixel,
        (span(1) / pitch_b).ceil() as usize * cells_per_pixel,
        along,
    ];
    let nodes = |c: [usize; 3]| c.iter().map(|c| c + 3).product::<usize>() * placed.sweep.k;
    let shrink = (MAX_COEFFS as f64 / nodes(cells) as f64).sqrt().min(1.0);
    for c in &mut cells[..2] {
        *c = ((*c as f64 * shrink) as usize).max(4);
    }
    cells
}
