//! The phase of one frequency in a pixel.

use std::f32::consts::TAU;
use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Vector3};

use super::group::WaveGroup;

/// Standard deviation of a normalized intensity beyond the sensor's noise: projected images have eight bits (0.0011),
/// and no sensor's curve is quite straight.
const PROJECTION_NOISE: f32 = 0.002;

/// Smallest amplitude of a phase, in standard deviations of its noise.
const MIN_AMPLITUDE_SIGMAS: f32 = 4.0;
/// Smallest amplitude of a phase, as a fraction of white.
const MIN_AMPLITUDE: f32 = 0.02;

/// Least-squares solution of `p_i = o + C cos φ_i + S sin φ_i` for offset, amplitude and phase of one frequency.
#[derive(Clone, Debug)]
pub struct PhaseSolver {
    images: Vec<usize>,
    /// Rows over the images: o, C, S.
    rows: [Vec<f32>; 3],
    omega: f32,
    gain: f32,
}

/// What one frequency shows in a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasuredPhase {
    /// Mean of the wave, normalized intensity.
    pub offset: f32,
    /// Amplitude of the wave, normalized intensity.
    pub amplitude: f32,
    /// Its phase 2πfu modulo 2π, radians.
    pub angle: f32,
    /// Standard deviation of the phase, radians.
    pub sigma: f32,
}

impl PhaseSolver {
    /// Returns the solver of a frequency; `None` if its shifts do not determine a phase.
    pub fn new(group: &WaveGroup) -> Option<Self> {
        let mut normal = Matrix3::zeros();
        let rows: Vec<Vector3<f64>> =
            group.waves.iter().map(|w| Vector3::new(1.0, w.phase.cos(), w.phase.sin())).collect();
        rows.iter().for_each(|r| normal += r * r.transpose());
        // Phases in one place determine nothing that noise would not drown.
        let smallest = normal.symmetric_eigenvalues().min();
        let inverse = normal.try_inverse().filter(|_| smallest > 0.05)?;
        let row = |k: usize| -> Vec<f32> { rows.iter().map(|r| (inverse * r)[k] as f32).collect() };
        let rows = [row(0), row(1), row(2)];
        let square = |row: &[f32]| row.iter().map(|v| v * v).sum::<f32>();
        let gain = (0.5 * (square(&rows[1]) + square(&rows[2]))).sqrt();
        let images = group.waves.iter().map(|w| w.image).collect();
        Some(Self { images, rows, omega: TAU * group.frequency as f32, gain })
    }

    /// Returns the phase's change per projector px, radians.
    pub fn omega(&self) -> f32 {
        self.omega
    }

    /// Returns the standard deviation of C and of S per standard deviation of the intensities.
    pub fn gain(&self) -> f32 {
        self.gain
    }

    /// Measures a pixel whose normalized intensity in image i is `value(i)`, with standard deviation `noise`. `None`
    /// where the amplitude is too small to be told from noise.
    #[inline]
    pub fn measure(&self, value: impl Fn(usize) -> f32, noise: f32) -> Option<MeasuredPhase> {
        let [mut o, mut c, mut s] = [0.0f32; 3];
        for (j, &image) in self.images.iter().enumerate() {
            let p = value(image);
            o += self.rows[0][j] * p;
            c += self.rows[1][j] * p;
            s += self.rows[2][j] * p;
        }
        let amplitude = c.hypot(s);
        let sigma = noise.hypot(PROJECTION_NOISE) * self.gain;
        (amplitude > (MIN_AMPLITUDE_SIGMAS * sigma).max(MIN_AMPLITUDE)).then(|| MeasuredPhase {
            offset: o,
            amplitude,
            angle: s.atan2(c),
            sigma: sigma / amplitude,
        })
    }

    /// Returns the numbers k of the periods in which a column of `[low, high]` has this phase: (phase + 2πk) / ω.
    #[inline]
    pub(super) fn periods(&self, phase: &MeasuredPhase, [low, high]: [f32; 2]) -> RangeInclusive<i32> {
        let period = TAU / self.omega;
        let column = phase.angle / self.omega;
        ((low - column) / period).ceil() as i32..=((high - column) / period).floor() as i32
    }
}

/// Returns an angle (radians) between −π and π.
#[inline]
pub fn wrap_angle(angle: f32) -> f32 {
    angle - TAU * (angle / TAU).round()
}
