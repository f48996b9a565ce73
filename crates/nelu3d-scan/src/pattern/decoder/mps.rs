//! Micro phase shifting (Gupta and Nayar, "Micro Phase Shifting", CVPR 2012): F frequencies from a narrow band in F + 2
//! images, three shifts of the first and one image of each other.

use std::f32::consts::TAU;

use super::column::{BestTwo, DecodedColumn};
use super::group::WaveGroup;
use super::solver::PhaseSolver;
use crate::pattern::error::PatternError;
use crate::pattern::phase::MAX_PERIODS;
use crate::pattern::wave::Wave;

/// Error of a cosine that noise does not explain: the amplitude is not quite the same for all frequencies.
const MODEL_ERROR: f32 = 0.06;

/// Decodes micro phase shifting.
///
/// All frequencies being close, offset and amplitude are the same for all: that is the method's point, as indirect
/// light hardly changes within a band of high frequencies. Offset o, amplitude B and phase of the first frequency come
/// from its shifts, the others give `cos(2π f_j u − φ_j) = (p_j − o) / B`: the paper's linear system of F + 2 unknowns,
/// solved in two steps. The column is the one, among those with the first frequency's phase, whose cosines are nearest
/// to these (its section 4), so that the fraction of a column is that of the first phase.
#[derive(Clone, Debug)]
pub struct MpsDecoder {
    n: usize,
    n_images: usize,
    first: PhaseSolver,
    others: Vec<SingleWave>,
}

/// A frequency with one image.
#[derive(Clone, Debug)]
struct SingleWave {
    image: usize,
    /// Radians per projector px.
    omega: f32,
    phase: f32,
}

impl MpsDecoder {
    /// Returns a decoder for `n` columns and images that show `waves`, in any order: one period in at least three
    /// shifts, every other in one.
    ///
    /// # Errors
    ///
    /// The waves are not such a set.
    pub fn new(waves: &[Wave], n: usize) -> Result<Self, PatternError> {
        Self::from_groups(&WaveGroup::all(waves, "mps")?, n)
    }

    /// Returns a decoder for `n` columns and images grouped by their frequency.
    ///
    /// # Errors
    ///
    /// The groups are not one of three shifts or more and others of one image each, or they are more than 64.
    pub fn from_groups(groups: &[WaveGroup], n: usize) -> Result<Self, PatternError> {
        let no = |problem| PatternError::Code { family: "mps", problem };
        let shifted = groups.iter().find(|g| g.waves.len() > 2);
        let shifted = shifted.ok_or(no("one period needs three or more images of different shifts"))?;
        let single: Vec<&WaveGroup> = groups.iter().filter(|g| g.waves.len() == 1).collect();
        if single.is_empty() || single.len() + 1 != groups.len() || groups.len() > MAX_PERIODS {
            return Err(no("all periods but one have one image each, and there is one such at least, and 63 at most"));
        }
        let first = PhaseSolver::new(shifted).ok_or(no("the shifts of its first period are not different"))?;
        let wave = |g: &WaveGroup| SingleWave {
            image: g.waves[0].image,
            omega: TAU * g.frequency as f32,
            phase: g.waves[0].phase as f32,
        };
        let n_images = groups.iter().map(|g| g.waves.len()).sum();
        Ok(Self { n, n_images, first, others: single.into_iter().map(wave).collect() })
    }

    /// Decodes a pixel from its normalized intensities, in the waves' order, which have standard deviation `noise`
    /// beyond that of 8-bit projection. Any column may be the one. `None` as for [`MpsDecoder::decode_within`].
    ///
    /// # Panics
    ///
    /// If there are more or fewer values than waves.
    pub fn decode(&self, values: &[f32], noise: f32) -> Option<DecodedColumn> {
        assert_eq!(values.len(), self.n_images, "one value per image");
        self.decode_within(|image| values[image], noise, [-0.5, self.n as f32 - 0.5])
    }

    /// Decodes a pixel whose normalized intensity in image i is `value(i)`, with standard deviation `noise`; `range` is
    /// where the column may lie, px. `None` where the amplitude is lost in noise, a value is not finite, or no column
    /// of the range has the first frequency's phase.
    pub fn decode_within(&self, value: impl Fn(usize) -> f32, noise: f32, range: [f32; 2]) -> Option<DecodedColumn> {
        let first = self.first.measure(&value, noise)?;
        // Decoders run over millions of pixels: no allocation.
        let mut cosines = [0.0f32; MAX_PERIODS];
        for (s, other) in cosines.iter_mut().zip(&self.others) {
            *s = (value(other.image) - first.offset) / first.amplitude;
        }
        // A cosine's own noise, that of offset and amplitude, and that of the column it is compared at: all alike.
        let variance = 2.5 * (noise / first.amplitude).powi(2) + MODEL_ERROR * MODEL_ERROR;
        let (omega, period) = (self.first.omega(), TAU / self.first.omega());
        let at = first.angle / omega;
        let mut best = BestTwo::new();
        for k in self.first.periods(&first, range) {
            let u = at + k as f32 * period;
            let squared = |(o, s): (&SingleWave, &f32)| (s - (o.omega * u - o.phase).cos()).powi(2);
            best.add(u, self.others.iter().zip(&cosines).map(squared).sum::<f32>() / variance);
        }
        let (column, misfit, runner_up) = best.found()?;
        let sigma = first.sigma / omega;
        Some(DecodedColumn { column, sigma, misfit, runner_up, measurements: self.others.len() })
    }
}
