//! A field in one frame, fitted without the held-out positions and measured at them.

use super::error::CalibrationError;
use super::fringes::{CarriedReport, Columns, carry};
use super::held_out::{Displacement, HeldOutErrors};
use super::options::{CalibrationOptions, FormKind};
use super::pass::{Pass, gathered};
use super::placed_sweep::PlacedSweep;
use super::predictor::Predictor;
use super::resolution::{is_limited, resolution, spline_cells};
use super::shared_displacement::{GrossSquares, SquareDisplacement};
use super::smoothing::{Aside, smoothness};
use super::spline_fit::{Schedule, SplineFit, fit_spline};
use super::support::Support;
use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::fit::{LeastSquares, Smoothness};
use crate::color_field::frame::{Center, FieldFrame};
use crate::color_field::frequency::{FrequencyForm, FrequencySettings};
use crate::color_field::grid::Grid;
use crate::color_field::hash::{HashForm, HashSettings};
use crate::color_field::published::{PublishedForm, PublishedSettings};
use crate::color_field::validity::Validity;
use crate::color_field::{Form, PixelQuality, Quality};
use crate::progress::Progress;
use nelu3d_field::device::Device;

/// Gaps between boards that a sweep is taken to have at least, where it says how far its rays reach beyond it.
const MIN_GAPS: usize = 4;
/// Cells of the validity volume along w.
const CELLS_ALONG_VALIDITY: usize = 32;
/// Shortfall of the held-out PSNR against what the noise allows, beyond which a field is not good, dB.
pub(super) const MAX_SHORTFALL_DB: f64 = 3.0;
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
    /// Variance of the codewords at the held-out positions, channel by channel, mean.
    pub(super) variance: f64,
    /// PSNR that noise and pixels allow at the held-out positions, dB, if any of their samples are well lit.
    pub(super) allowed_db: Option<f64>,
    /// Held-out PSNR of every position that was held out, dB; those that no others support are missing.
    pub(super) by_position: Vec<(String, f64)>,
    /// By how much the held-out positions seem to be displaced.
    pub(super) displacements: Vec<Displacement>,
    /// Mean square of what held-out positions are off by in depth where others have been, mm², where positions are held
    /// out in turn and enough of them tell.
    pub(super) off_mm2: Option<f64>,
    /// What squares of the held-out positions are off by in depth, where positions are held out in turn.
    pub(super) squares: Vec<SquareDisplacement>,
    /// Parts of the held-out positions that are far off, where positions are held out in turn.
    pub(super) gross: Option<GrossSquares>,
    /// Whether it has fewer cells across than the camera has pixels there.
    pub(super) is_limited: bool,
    /// How it was fitted.
    schedule: Schedule,
    /// How smooth it is.
    pub(super) smooth: Smoothness,
    /// Steps that the final fit takes.
    final_steps: usize,
    /// The part along the light's rays that holds, in unit coordinates.
    reached: [f32; 2],
    /// What the final fit carried along the stripes of the code.
    pub(super) carried: Option<CarriedReport>,
}

impl Candidate {
    /// Fits a field in `frame` (whose box is still empty) without the positions of each of `folds` in turn, and
    /// measures it at these. With one fold, every position is read once: first those that are fitted, then the held-out
    /// ones, which are compared with the field and join the others in the bins. With several, all are gathered first,
    /// and every fold's are taken out while the others are fitted. How smooth it is, is found, unless it is known.
    pub(super) fn fit(
        cx: &FitContext<'_, '_>,
        mut frame: FieldFrame,
        center: Center,
        cells_per_pixel: usize,
        folds: &[Vec<usize>],
        known: Option<&Smoothness>,
    ) -> Result<Self, CalibrationError> {
        let FitContext { placed, opts, progress, .. } = *cx;
        let swept = enclose(placed, &mut frame, center);
        let cells = resolution(placed, &frame, center, cells_per_pixel);
        let mut validity = empty_validity(placed, cells, cells_per_pixel);
        let mut bins = empty_bins(placed, cells, center, opts.form);
        let mut support = Support::new(center, &validity);
        let in_turn = folds.len() > 1;
        let schedule = Schedule::of(center, in_turn);
        let first: Vec<usize> = (0..placed.n_positions()).filter(|p| in_turn || !folds[0].contains(p)).collect();
        let mut pass = Pass { placed, frame: &frame, progress, bins: &mut bins, validity: &mut validity };
        let mut aside = (opts.form == FormKind::Grid && known.is_none()).then(|| {
            let mut by_depth = placed.in_depth_order();
            by_depth.retain(|p| first.contains(p));
            Aside::new(&by_depth, in_turn, cells, cells_per_pixel)
        });
        let mut usable = pass.gather(&first, Some(&mut support), aside.as_mut())?;
        // With so few that the held-out ones decide whether there are enough, they are looked at first.
        if usable < MIN_SAMPLES && !in_turn {
            let (mut bins, mut validity) =
                (empty_bins(placed, cells, center, opts.form), empty_validity(placed, cells, cells_per_pixel));
            let mut pass = Pass { placed, frame: &frame, progress, bins: &mut bins, validity: &mut validity };
            usable += pass.gather(&folds[0], None, None)?;
        }
        if usable < MIN_SAMPLES {
            return Err(no_samples(placed, opts));
        }
        let k = placed.sweep.k;
        let smooth = aside.map_or_else(
            || known.cloned().unwrap_or_else(|| smoothness(center, vec![[1.0; 3]; k])),
            |aside| {
                let prepare = |bins: &Bins, cells| SplineFit::new(bins, cells, schedule);
                let [a, b] = [0, 1].map(|i| (frame.hi[i] - frame.lo[i]) / cells[i] as f64);
                aside.choose(&mut bins, cells[2], (a / b).powi(2), center, prepare, progress)
            },
        );
        let (mut errors, mut by_position, mut form, mut pixels) = (HeldOutErrors::default(), Vec::new(), None, None);
        for fold in folds {
            let mut others = None;
            if in_turn {
                bins.remove_all(&gathered(placed, &frame, fold, &bins, progress)?);
                others = (center == Center::Light).then(|| Others::add_carried(&mut bins, &validity, cells_per_pixel));
            }
            let (fitted, at_pixels) = fit_form(cx, &bins, &frame, cells, (&smooth, schedule));
            pixels = at_pixels;
            let mut pass = Pass { placed, frame: &frame, progress, bins: &mut bins, validity: &mut validity };
            // A position supports its own samples, too, where it was counted. From one other board alone nothing tells
            // how the light's focus changes along a ray; of three, no more can be asked.
            let least = match (in_turn, placed.n_positions()) {
                (false, _) => 1,
                (true, ..4) => 2,
                (true, _) => 3,
            };
            let n_held_out = folds.iter().map(Vec::len).sum::<usize>().max(1);
            let predictor = Predictor::of(&fitted);
            let known = others.as_ref().map(|others| &others.known);
            for (p, e) in pass.compare(fold, &predictor, n_held_out, &support, (least, u16::from(in_turn)), known)? {
                by_position.extend(e.psnr_db().map(|db| (placed.sweep.shots[p].name.clone(), db)));
                errors.merge(e);
            }
            drop(predictor);
            if let Some(carried) = others.and_then(|others| others.carried) {
                bins.remove_all(&[carried]);
            }
            form = Some(fitted);
            if progress.cancelled() {
                return Err(CalibrationError::Cancelled);
            }
        }
        tracing::debug!(?by_position, "held out");
        validity.close();
        validity.fill_holes();
        let held_out = folds.concat().iter().map(|p| placed.sweep.shots[*p].name.clone()).collect();
        let variance = errors.variance();
        let allowed_db = errors.allowed_db();
        let displacements = errors.displacements().to_vec();
        let gross = errors.gross();
        let squares = errors.by_support.squares.clone();
        let off_mm2 = errors.by_support.mean_square_mm2();
        let quality = Quality { pixels, ..errors.quality(held_out, placed.n_positions()) };
        let is_good = quality.psnr_db > quality.ceiling_db - MAX_SHORTFALL_DB;
        let reached = if is_good || ends_hold(placed, &by_position) { [0.0, 1.0] } else { swept };
        if center == Center::Light {
            validity.extend(reached);
            find_ranges(placed, &frame, &mut validity);
        }
        Ok(Self {
            frame,
            center,
            cells,
            cells_per_pixel,
            form: form.expect("there is a fold"),
            bins: Some(bins),
            validity,
            quality,
            variance,
            allowed_db,
            by_position,
            displacements,
            off_mm2,
            squares,
            gross,
            is_limited: is_limited(placed, &frame, cells),
            schedule,
            smooth,
            final_steps: if in_turn { schedule.anew(placed.sweep.binning).steps } else { schedule.joined },
            reached,
            carried: None,
        })
    }

    /// Frees the bins' memory for another candidate's.
    pub(super) fn drop_bins(&mut self) {
        self.bins = None;
    }

    /// Fits the field to all positions, from where it is.
    pub(super) fn fit_all_positions(&mut self, cx: &FitContext<'_, '_>) -> Result<Form, CalibrationError> {
        let FitContext { placed, opts, progress, .. } = *cx;
        let mut bins = match self.bins.take() {
            Some(bins) => bins,
            None => {
                let mut bins = empty_bins(placed, self.cells, self.center, opts.form);
                let mut validity = empty_validity(placed, self.cells, self.cells_per_pixel);
                let all: Vec<usize> = (0..placed.n_positions()).collect();
                let frame = &self.frame;
                Pass { placed, frame, progress, bins: &mut bins, validity: &mut validity }.gather(&all, None, None)?;
                bins
            }
        };
        let empty = Form::Grid(Grid::new([1, 1, 1], 1));
        let mut form = std::mem::replace(&mut self.form, empty);
        if self.center == Center::Light
            && let Some(carried) = carry(&bins, &self.validity, None, self.cells_per_pixel)
        {
            drop(form);
            carried.light(&mut self.validity);
            bins.add_all(&[carried.samples]);
            drop(carried.places);
            self.carried = Some(carried.report);
            self.validity.extend(self.reached);
            find_ranges(placed, &self.frame, &mut self.validity);
            // From nothing: where carried samples lie there was nothing to go on from.
            let schedule = self.schedule.anew(placed.sweep.binning);
            if opts.form == FormKind::Grid {
                return Ok(Form::Grid(fit_spline(&bins, self.cells, schedule, &self.smooth, progress)));
            }
            return Ok(fit_form(cx, &bins, &self.frame, self.cells, (&self.smooth, schedule)).0);
        }
        match &mut form {
            Form::Grid(grid) if self.smooth.defocus.is_some() => {
                // From nothing: the defocus is in the spline.
                let schedule = self.schedule.with_steps(self.final_steps);
                *grid = fit_spline(&bins, self.cells, schedule, &self.smooth, progress);
            }
            Form::Grid(grid) => {
                let problem = LeastSquares::new(grid.cells, &bins);
                // Of a large sensor they are a third of the memory.
                drop(bins);
                problem.solve_once(grid, &self.smooth, self.final_steps, progress);
            }
            Form::Hash(hash) => {
                hash.train(&bins, opts.seed.wrapping_add(1), cx.device, progress);
            }
            Form::Frequency(frequency) => frequency.train(&bins, opts.seed.wrapping_add(1), progress),
            Form::Published(published) => {
                // Anew and at full length, as published.
                let (settings, k) = (published.shape().settings.clone(), published.k());
                **published = PublishedForm::new(settings, k, opts.seed.wrapping_add(1));
                published.train(&bins, opts.seed.wrapping_add(1), progress);
            }
        }
        Ok(form)
    }
}

/// What the positions that are not held out tell beside their own samples.
struct Others {
    /// The rays of light whose codewords they tell, carried ones included.
    known: Validity,
    /// The samples that were carried along the stripes.
    carried: Option<Gathered>,
}

impl Others {
    /// Carries samples of the other positions along the stripes and adds them to `bins`, which hold those positions
    /// alone. Only rays that are lit in `all`, the volume of all positions, are filled: no others are compared.
    fn add_carried(bins: &mut Bins, all: &Validity, cells_per_pixel: usize) -> Self {
        let mut known = Columns::lit_in(bins, all);
        let carried = carry(bins, &known, Some(all), cells_per_pixel).map(|carried| {
            carried.light(&mut known);
            known.extend([0.0, 1.0]);
            bins.add_all(std::slice::from_ref(&carried.samples));
            carried.samples
        });
        Self { known, carried }
    }
}

/// Puts the box of a frame around the sweep; in the light's frame, with room for what its rays reach beyond the first
/// and the last board: as far as boards are apart. Returns the part along w where boards were, in unit coordinates.
fn enclose(placed: &PlacedSweep<'_>, frame: &mut FieldFrame, center: Center) -> [f32; 2] {
    placed.for_each_point(|x| frame.enclose(x));
    // A hair of margin: the box was found from every seventh sample.
    for i in 0..3 {
        let margin = 0.01 * (frame.hi[i] - frame.lo[i]);
        frame.lo[i] -= margin;
        frame.hi[i] += margin;
    }
    let [lo, hi] = [frame.lo[2], frame.hi[2]];
    if center == Center::Light {
        let mm = |w: f64| w / (1.0 - frame.kappa * w);
        let w = |mm: f64| mm / (1.0 + frame.kappa * mm);
        let reach = (mm(hi) - mm(lo)) / (placed.n_positions() - 1).max(MIN_GAPS) as f64;
        let (near, far) = (mm(lo) - reach, mm(hi) + reach);
        // Not into the light itself.
        if 1.0 + frame.kappa * near > 0.1 {
            frame.lo[2] = w(near);
        }
        if 1.0 + frame.kappa * far > 0.1 {
            frame.hi[2] = w(far);
        }
    }
    let unit = |w: f64| ((w - frame.lo[2]) / (frame.hi[2] - frame.lo[2])) as f32;
    [unit(lo), unit(hi)]
}

/// Whether the nearest and the farthest position, held out in turn, were predicted from the others as well as those
/// between them: then the field holds beyond its boards as far as these are apart.
fn ends_hold(placed: &PlacedSweep<'_>, by_position: &[(String, f64)]) -> bool {
    let n = placed.n_positions();
    if by_position.len() < n {
        return false;
    }
    let order = placed.in_depth_order();
    let db = |p: usize| by_position.iter().find(|q| q.0 == placed.sweep.shots[p].name).map_or(f64::NAN, |q| q.1);
    let between = order[1..n - 1].iter().map(|p| db(*p)).sum::<f64>() / (n - 2) as f64;
    [order[0], order[n - 1]].into_iter().all(|p| db(p) > between - MAX_SHORTFALL_DB)
}

/// Ranges of the tiles' rays, from the lit cells.
fn find_ranges(placed: &PlacedSweep<'_>, frame: &FieldFrame, validity: &mut Validity) {
    let (mut near, mut far) = (f64::INFINITY, 0.0f64);
    for corner in 0..8 {
        let t = frame.from_unit([0, 1, 2].map(|i| f64::from(corner >> i & 1))).coords.norm();
        (near, far) = (near.min(t), far.max(t));
    }
    let middle = frame.from_unit([0.5, 0.5, 0.0]).coords.norm();
    let sensor = placed.sweep.sensor();
    let ray = |px: [f64; 2]| {
        let ray = frame.along_ray(&sensor.ray(px).dir);
        move |t: f64| ray.at(t).q
    };
    validity.find_ranges([0.9 * near.min(middle), 1.1 * far], ray);
}

/// Fits a form of the field over the box of `frame` from nothing; with it, form `published` returns its quality at
/// random samples that were held out.
fn fit_form(
    cx: &FitContext<'_, '_>,
    bins: &Bins,
    frame: &FieldFrame,
    cells: [usize; 3],
    (smooth, schedule): (&Smoothness, Schedule),
) -> (Form, Option<PixelQuality>) {
    let FitContext { placed, opts, progress, .. } = *cx;
    let k = placed.sweep.k;
    let form = match opts.form {
        FormKind::Grid => Form::Grid(fit_spline(bins, cells, schedule, smooth, progress)),
        FormKind::Hash => {
            let mut hash = HashForm::new(HashSettings::for_cells(cells), k, opts.seed);
            hash.train(bins, opts.seed, cx.device, progress);
            Form::Hash(Box::new(hash))
        }
        FormKind::Frequency => {
            let settings = FrequencySettings::for_cells(cells, opts.octaves);
            let mut frequency = FrequencyForm::new(settings, k, opts.seed);
            frequency.train(bins, opts.seed, progress);
            Form::Frequency(Box::new(frequency))
        }
        FormKind::Published => {
            let settings = PublishedSettings::new(spline_cells(cells, k), *frame, opts.published.clone());
            let mut published = PublishedForm::new(settings, k, opts.seed);
            let pixels = published.train_and_compare(bins, opts.seed, progress);
            return (Form::Published(Box::new(published)), pixels);
        }
    };
    (form, None)
}

fn no_samples(placed: &PlacedSweep<'_>, opts: &CalibrationOptions) -> CalibrationError {
    let path = placed.sweep.folder();
    let reason = if placed.is_in_view() {
        format!(
            "no pixel of the board is usable in any position: white − black is below {:.0} % of full scale or an image is \
             clipped everywhere; check exposure, `saturation` and `black_level`, and that white.png is the flash",
            opts.min_contrast * 100.0
        )
    } else {
        let extent = placed.boards.first().map(|b| b.extent_mm()).unwrap_or_default();
        format!(
            "the usable part of the board lies outside of the image at every position: rig.toml says `board.extent_mm` = \
             {extent:?}; give its outline in the board's own frame, or leave the key out"
        )
    };
    CalibrationError::NoSamples { path, reason }
}

/// Two bins a cell along w, and three along the light's rays for the forms with a network, which are no splines and
/// lose by less; no fewer than four.
fn empty_bins(placed: &PlacedSweep<'_>, cells: [usize; 3], center: Center, form: FormKind) -> Bins {
    let per_cell = match (center, form) {
        (Center::Light, FormKind::Hash | FormKind::Frequency) => 3,
        _ => 2,
    };
    Bins::new([cells[0], cells[1], (cells[2] * per_cell).max(4)], placed.sweep.k)
}

/// Ranges along the rays of tiles of the pixels that are read, and lit cells of the frame: two pixels wide, however many
/// cells the field has, as samples of a few boards lie a pixel apart.
fn empty_validity(placed: &PlacedSweep<'_>, cells: [usize; 3], cells_per_pixel: usize) -> Validity {
    const TILE: usize = 8;
    let [a, b] = [cells[0], cells[1]].map(|n| (n / (2 * cells_per_pixel)).max(1));
    let lit = [a, b, CELLS_ALONG_VALIDITY];
    let sensor = placed.sweep.sensor();
    Validity::new(sensor.width, sensor.height, TILE * placed.sweep.binning, lit)
}
