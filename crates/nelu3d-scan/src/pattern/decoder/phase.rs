//! Phase shifting: three or more shifts of each of one or several frequencies.

use super::column::{BestTwo, DecodedColumn};
use super::group::WaveGroup;
use super::solver::{MeasuredPhase, PhaseSolver, wrap_angle};
use crate::pattern::error::PatternError;
use crate::pattern::phase::MAX_PERIODS;
use crate::pattern::wave::Wave;

use std::f32::consts::TAU;

/// Phase error that noise does not explain (gamma, quantized projection, interreflection), radians.
const MODEL_ERROR: f32 = 0.05;

/// Decodes phase-shifted waves of one or several periods.
///
/// The phase of each frequency is a linear least-squares fit, for any shifts. The finest phase says where in its period
/// a column is; the others say which period: among all columns with the finest phase, the one whose other phases agree
/// best with what was measured (χ²). Then all unwrapped phases are averaged by their variances. This does what
/// heterodyne (beat) unwrapping and number-theoretic tables (Gushov and Solodkin 1991) do where those are exact, takes
/// any periods, and uses every phase at once, so no noise is amplified from level to level.
#[derive(Clone, Debug)]
pub struct PhaseDecoder {
    n: usize,
    n_images: usize,
    /// The finest first.
    solvers: Vec<PhaseSolver>,
}

impl PhaseDecoder {
    /// Returns a decoder for `n` columns and images that show `waves`, in any order; each period needs three shifts.
    ///
    /// # Errors
    ///
    /// No waves, more than 64 periods, a period out of range, or fewer than three different shifts of one.
    pub fn new(waves: &[Wave], n: usize) -> Result<Self, PatternError> {
        Self::from_groups(&WaveGroup::all(waves, "phase")?, n)
    }

    /// Returns a decoder for `n` columns and images grouped by their frequency, the highest first.
    ///
    /// # Errors
    ///
    /// No groups, more than 64, or one whose shifts do not determine a phase.
    pub fn from_groups(groups: &[WaveGroup], n: usize) -> Result<Self, PatternError> {
        let no = |problem| PatternError::Code { family: "phase", problem };
        if groups.is_empty() {
            return Err(no("there is no image"));
        }
        if groups.len() > MAX_PERIODS {
            return Err(no("it has more than 64 periods"));
        }
        let solvers: Option<Vec<PhaseSolver>> = groups.iter().map(PhaseSolver::new).collect();
        let solvers = solvers.ok_or(no("each period needs three or more images of different shifts"))?;
        let n_images = groups.iter().map(|g| g.waves.len()).sum();
        Ok(Self { n, n_images, solvers })
    }

    /// Decodes a pixel from its normalized intensities, in the waves' order, which have standard deviation `noise`
    /// beyond that of 8-bit projection. Any column may be the one. `None` as for [`PhaseDecoder::decode_within`].
    ///
    /// # Panics
    ///
    /// If there are more or fewer values than waves.
    pub fn decode(&self, values: &[f32], noise: f32) -> Option<DecodedColumn> {
        assert_eq!(values.len(), self.n_images, "one value per image");
        self.decode_within(|image| values[image], noise, [-0.5, self.n as f32 - 0.5])
    }

    /// Decodes a pixel whose normalized intensity in image i is `value(i)`, with standard deviation `noise`; `range` is
    /// where the column may lie, px. `None` where an amplitude is lost in noise, a value is not finite, or no column of
    /// the range has the finest phase.
    pub fn decode_within(&self, value: impl Fn(usize) -> f32, noise: f32, range: [f32; 2]) -> Option<DecodedColumn> {
        // Decoders run over millions of pixels: no allocation.
        let mut measured = [MeasuredPhase::default(); MAX_PERIODS];
        let measured = &mut measured[..self.solvers.len()];
        for (m, solver) in measured.iter_mut().zip(&self.solvers) {
            *m = solver.measure(&value, noise)?;
        }
        let (finest, omega) = (measured[0], self.solvers[0].omega());
        let mut best = BestTwo::new();
        for k in self.solvers[0].periods(&finest, range) {
            let u = (finest.angle + TAU * k as f32) / omega;
            let mut cost = 0.0;
            for (s, solver) in measured[1..].iter().zip(&self.solvers[1..]) {
                let carried = finest.sigma * solver.omega() / omega;
                let off = wrap_angle(s.angle - solver.omega() * u);
                cost += off * off / (s.sigma * s.sigma + carried * carried + MODEL_ERROR * MODEL_ERROR);
            }
            best.add(u, cost);
        }
        let (column, misfit, runner_up) = best.found()?;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (s, solver) in measured.iter().zip(&self.solvers) {
            let w = (solver.omega() / s.sigma.max(1e-6)).powi(2);
            sum += w * wrap_angle(s.angle - solver.omega() * column) / solver.omega();
            weights += w;
        }
        let measurements = (measured.len() - 1).max(1);
        Some(DecodedColumn {
            column: column + sum / weights,
            sigma: 1.0 / weights.sqrt(),
            misfit,
            runner_up,
            measurements,
        })
    }
}

/// Returns after how many px all phases are back where they were, to within what noise leaves; `None` if no two of `n`
/// columns are that far apart. The groups are those of a phase-shifting code, the highest frequency first.
pub fn repeats_after(groups: &[WaveGroup], n: f64) -> Option<f32> {
    let finest = groups[0].period_px();
    let returns =
        |s: f64, g: &WaveGroup| wrap_angle((f64::from(TAU) * s * g.frequency) as f32).abs() < 3.0 * MODEL_ERROR;
    (1..)
        .map(|k| f64::from(k) * finest)
        .take_while(|s| *s < n - 0.5)
        .find(|s| groups[1..].iter().all(|g| returns(*s, g)))
        .map(|s| s as f32)
}
