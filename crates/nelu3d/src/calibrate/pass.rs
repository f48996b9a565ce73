//! Reading positions of the sweep into bins.

use nalgebra::Point3;

use super::error::CalibrationError;
use super::held_out::HeldOutErrors;
use super::placed_sweep::{PlacedSweep, Seen};
use super::predictor::Predictor;
use super::shared_displacement::{CLASSES, DisplacementsBySupport};
use super::smoothing::Aside;
use super::support::Support;
use super::sweep::Position;
use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::frame::FieldFrame;
use crate::color_field::validity::{KnownAxes, Validity};
use crate::progress::Progress;

/// Smallest weight of a sample that says where the field is known: a standard deviation of 0.1 of the normalized
/// intensity. Black ink has less.
const MIN_WEIGHT: f32 = 100.0;

/// Where what is read goes.
pub(super) struct Pass<'a, 'r> {
    pub(super) placed: &'a PlacedSweep<'r>,
    pub(super) frame: &'a FieldFrame,
    pub(super) progress: &'a Progress,
    pub(super) bins: &'a mut Bins,
    pub(super) validity: &'a mut Validity,
}

/// What one position leaves: its samples on their way to the bins, and where they were.
struct Passed {
    position: usize,
    gathered: Gathered,
    validity: Validity,
    n: usize,
}

impl Passed {
    fn of(
        placed: &PlacedSweep<'_>,
        frame: &FieldFrame,
        into: (&Gathered, &Validity),
        p: usize,
        read: &Position,
    ) -> Self {
        let mut out = Self { position: p, gathered: into.0.clone(), validity: into.1.clone(), n: 0 };
        let width = placed.camera.width;
        let mut w = vec![0.0; placed.sweep.k];
        placed.for_each_usable(p, read, |i, Seen { dir, t }| {
            out.n += 1;
            if let Some(q) = frame.to_unit(&Point3::from(dir * t)) {
                read.weights_in_means(i, &placed.noise, &mut w);
                if w.iter().any(|w| *w > MIN_WEIGHT) {
                    out.validity.add(placed.sweep.on_sensor([i % width, i / width]), t as f32, q);
                }
                out.gathered.push(q, &read.values[i * read.k..][..read.k], &w);
            }
        });
        out
    }
}

impl Pass<'_, '_> {
    /// An empty volume of the same shape.
    fn blank(&self) -> Validity {
        let shape = self.validity.shape;
        let sensor = self.placed.sweep.sensor();
        Validity::new(sensor.width, sensor.height, shape.tile_px, shape.cells)
    }

    /// Adds positions to bins and validity, and to `support` where it is asked for; what `aside` sets aside it gets,
    /// too. Returns the number of usable samples.
    pub(super) fn gather(
        &mut self,
        which: &[usize],
        mut support: Option<&mut Support>,
        mut aside: Option<&mut Aside>,
    ) -> Result<usize, CalibrationError> {
        let (placed, frame, empty, blank) = (self.placed, self.frame, self.bins.gathered(), self.blank());
        let map = |p: usize, (): (), read: &Position| Passed::of(placed, frame, (&empty, &blank), p, read);
        let mut usable = 0;
        let take = |wave: Vec<Passed>| {
            for p in &wave {
                usable += p.n;
                self.validity.add_position(&p.validity);
                if let Some(support) = &mut support {
                    support.add(&p.validity);
                }
                if let Some(aside) = &mut aside {
                    aside.keep(p.position, &p.gathered);
                }
            }
            self.bins.add_all(&wave.into_iter().map(|p| p.gathered).collect::<Vec<_>>());
        };
        placed.sweep.stream(which, self.progress, |(), _| {}, map, take)?;
        Ok(usable)
    }

    /// Compares positions with a field where at least `least` positions support it, of which `counted` are not in the
    /// field; `n_held_out` positions are compared in all. Then adds them to bins and validity. `known` is where the
    /// field is known, where displacements are to be told by the number of boards that support it.
    pub(super) fn compare(
        &mut self,
        which: &[usize],
        field: &Predictor<'_>,
        n_held_out: usize,
        support: &Support,
        (least, counted): (u16, u16),
        known: Option<&Validity>,
    ) -> Result<Vec<(usize, HeldOutErrors)>, CalibrationError> {
        let (placed, frame, empty, blank) = (self.placed, self.frame, self.bins.gathered(), self.blank());
        let map = |p: usize, (): (), read: &Position| {
            let passed = Passed::of(placed, frame, (&empty, &blank), p, read);
            let supporting = |q: [f32; 3]| support.at(q, least).saturating_sub(counted);
            let mut errors = HeldOutErrors::of(placed, frame, field, p, read, n_held_out, supporting);
            if let (Some(known), Some(grid)) = (known, field.spline()) {
                let support = |q: [f32; 3]| match support.at(q, 1 + counted).saturating_sub(counted) {
                    0 => Some((0, known.known_at(q))).filter(|(_, axes)| !axes.is_none()),
                    n => Some((usize::from(n).min(CLASSES - 1), KnownAxes::ALL)),
                };
                let at = (p, read);
                errors.by_support = DisplacementsBySupport::of(placed, frame, grid, at, &known.axes, support);
            }
            (passed, (p, errors))
        };
        let mut errors = Vec::new();
        let take = |wave: Vec<(Passed, (usize, HeldOutErrors))>| {
            let mut all = Vec::with_capacity(wave.len());
            for (p, e) in wave {
                // Those that are taken out in turn are in it already.
                if counted == 0 {
                    self.validity.add_position(&p.validity);
                }
                all.push(p.gathered);
                errors.push(e);
            }
            self.bins.add_all(&all);
        };
        placed.sweep.stream(which, self.progress, |(), _| {}, map, take)?;
        Ok(errors)
    }
}

/// The samples of positions, as they were added to `bins`.
pub(super) fn gathered(
    placed: &PlacedSweep<'_>,
    frame: &FieldFrame,
    which: &[usize],
    bins: &Bins,
    progress: &Progress,
) -> Result<Vec<Gathered>, CalibrationError> {
    let (empty, mut all) = (bins.gathered(), Vec::new());
    let sensor = placed.sweep.sensor();
    let blank = Validity::new(sensor.width, sensor.height, sensor.width.max(1), [1, 1, 1]);
    let map = |p: usize, (): (), read: &Position| Passed::of(placed, frame, (&empty, &blank), p, read).gathered;
    placed.sweep.stream(which, progress, |(), _| {}, map, |wave| all.extend(wave))?;
    Ok(all)
}
