//! Variances on a uniform thin plate of infinite extent, as integrals over spatial frequencies.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Means over all spatial frequencies of a uniform plate's lattice, for one ratio ρ of the plate's weight to
/// information. With s the symbol of the plate, a solution retains 1/(1 + ρs) of the noise's amplitude at a frequency,
/// and misses ρs/(1 + ρs) of the surface's.
#[derive(Clone, Copy, Default)]
pub(super) struct FrequencyMeans {
    /// Mean of 1/(1 + ρs)²: the noise's variance times the information, and the energy of the surface in the solution.
    pub(super) noise: f32,
    /// Mean of ρs/(1 + ρs)²: the prior's variance times the information, and the energy of the noise.
    pub(super) prior: f32,
    /// Energy of the surface, of second differences less their mean over a square of [`square()`].
    pub(super) surface_energy: f32,
    /// Energy of the noise, likewise.
    pub(super) noise_energy: f32,
    /// Mean of (ρs)² (1 + 2ρs)²/(1 + ρs)⁶: the noise's variance times the information in what is found to be smoothed
    /// away.
    pub(super) smoothed_away: f32,
}

/// Sides of the smallest and the largest square over which second differences are averaged, px. In smaller ones noise
/// would have a part in the mean.
const SQUARE: [f32; 2] = [5.0, 17.0];

/// Returns the side of the square about whose mean second differences are rough, px, for a solution that averages over
/// so many pixels: twice as wide as these. What does not change within it is not smoothed away, and what is may change
/// within it.
pub(super) fn square(pixels: f32) -> f32 {
    (2.0 * pixels.max(1.0).sqrt()).clamp(SQUARE[0], SQUARE[1])
}

/// Smallest and largest ln ρ of the table.
const RATIOS: [i32; 2] = [-14, 20];
/// Steps of the table per unit of ln ρ.
const STEPS: i32 = 4;

/// [`FrequencyMeans`] for every ratio; beyond the last, variances fall as 1/√ρ.
static MEANS: LazyLock<Vec<FrequencyMeans>> = LazyLock::new(|| {
    const N: usize = 96;
    // Finer where s is small, which is what matters for large ρ: frequencies are spaced as squares.
    let node = |i: usize| {
        let u = (i as f64 + 0.5) / N as f64;
        (PI * u * u, 2.0 * u / N as f64)
    };
    // The plate does not tell its two axes apart: one of each two frequencies that differ in their order is enough.
    let mut symbols = Vec::with_capacity(N * (N + 1) / 2);
    for i in 0..N {
        for j in 0..=i {
            let ((fx, wx), (fy, wy)) = (node(i), node(j));
            let (x, y) = (2.0 - 2.0 * fx.cos(), 2.0 - 2.0 * fy.cos());
            let times = if i == j { 1.0 } else { 2.0 };
            // (x + y)²: the squares of both straight differences, and twice that of the mixed one.
            symbols.push(((x + y).powi(2), times * wx * wy, [i, j]));
        }
    }
    let total: f64 = symbols.iter().map(|s| s.1).sum();
    (RATIOS[0] * STEPS..=RATIOS[1] * STEPS)
        .map(|step| {
            let ratio = (f64::from(step) / f64::from(STEPS)).exp();
            let mean = |f: &dyn Fn(f64, [usize; 2]) -> f64| {
                (symbols.iter().map(|(s, weight, at)| weight * f(ratio * s, *at)).sum::<f64>() / total) as f32
            };
            let noise = mean(&|q, _| (1.0 + q).powi(-2));
            let side = f64::from(square(1.0 / noise));
            let left: Vec<f64> = (0..N).map(|i| of_square(side, node(i).0)).collect();
            let rest = |[i, j]: [usize; 2]| (1.0 - left[i] * left[j]).powi(2);
            FrequencyMeans {
                noise,
                prior: mean(&|q, _| q * (1.0 + q).powi(-2)),
                surface_energy: mean(&|q, at| (1.0 + q).powi(-2) * rest(at)),
                noise_energy: mean(&|q, at| q * (1.0 + q).powi(-2) * rest(at)),
                smoothed_away: mean(&|q, _| (q * (1.0 + 2.0 * q)).powi(2) * (1.0 + q).powi(-6)),
            }
        })
        .collect()
});

impl FrequencyMeans {
    /// Interpolates the means for a ratio ρ.
    pub(super) fn at(ratio: f32) -> Self {
        let (a, b, t) = Self::around(ratio);
        let between = |a: f32, b: f32| a + t * (b - a);
        Self {
            noise: between(a.noise, b.noise),
            prior: between(a.prior, b.prior),
            surface_energy: between(a.surface_energy, b.surface_energy),
            noise_energy: between(a.noise_energy, b.noise_energy),
            smoothed_away: between(a.smoothed_away, b.smoothed_away),
        }
    }

    /// Interpolates [`Self::noise`] alone.
    pub(super) fn noise_at(ratio: f32) -> f32 {
        let (a, b, t) = Self::around(ratio);
        a.noise + t * (b.noise - a.noise)
    }

    /// Returns the entries of the table around a ratio, and how far it lies from the first towards the second.
    fn around(ratio: f32) -> (&'static Self, &'static Self, f32) {
        let position = (ratio.max(f32::MIN_POSITIVE).ln() - RATIOS[0] as f32) * STEPS as f32;
        let position = position.clamp(0.0, (MEANS.len() - 1) as f32 - 1e-3);
        (&MEANS[position as usize], &MEANS[position as usize + 1], position.fract())
    }
}

/// Returns the part of a frequency, radians per pixel, that a mean over so many pixels leaves.
fn of_square(side: f64, frequency: f64) -> f64 {
    (0.5 * side * frequency).sin() / (side * (0.5 * frequency).sin())
}
