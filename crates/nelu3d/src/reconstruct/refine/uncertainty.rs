//! How far to trust each depth: one standard deviation, from what the method knows without a truth.
//!
//! Three parts, added as variances:
//!
//! 1. the sensor's noise, as large as the residuals show it, carried through the last linear system;
//! 2. what the thin plate smooths away, scaled by how rough the found surface really is: the plate allows every surface a least
//!    roughness, and many are smoother;
//! 3. what is systematic: light that no part of the model explains (cross-talk of colors, errors of the color field, light by
//!    way of other surfaces). It differs from noise in that neighbors share it, so averaging over the plate does not remove it. It
//!    is seen in the directions of code space that depth cannot explain, channel by channel, and taken to be as large where it is not.
//!
//! The first two are diagonals of matrices of the size of the image. A pixel's are taken from a uniform plate of infinite extent with the
//! pixel's own weight and information, for which they are integrals over spatial frequencies; free edges make them larger.

use std::f64::consts::PI;
use std::sync::LazyLock;

use rayon::prelude::*;

use super::thin_plate::ThinPlatePrior;
use nelu3d_scan::image::box_mean;

/// Radius over which a pixel's weight and information are pooled, px.
const LOCAL_RADIUS: usize = 1;
/// And its variances.
const POOL_RADIUS: usize = 2;
/// Radius over which information is pooled where pixels themselves have next to none, px.
const FAR_RADIUS: usize = 8;
/// Radius within which edges of the surface are felt, px.
const EDGE_RADIUS: usize = 3;
/// By how much more the variance is at a straight edge: solutions of real systems have 1.9 to 2.5 times as much there.
const EDGE: f32 = 1.3;
/// Radius over which the surface's roughness is compared with the plate's, px.
const ROUGHNESS_RADIUS: usize = 12;
/// Radius of the squares that share a systematic error, px: about what the plate averages over.
const SHARED_RADIUS: usize = 2;
/// Radius over which the size of systematic errors is estimated, px.
const SYSTEMATIC_RADIUS: usize = 16;
/// Radius over which residuals tell how large the noise really is, px.
const NOISE_RADIUS: usize = 8;

/// What one pixel's last step says about its uncertainty.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Information {
    /// Σ w J², in units of the unknown.
    pub h: f32,
    /// χ² per measurement: its mean around a pixel is how much more or less noise there is than the model says.
    pub chi2: f32,
}

/// One standard deviation of the unknown per pixel of the plate's window; NaN where there is no surface. `systematic` is
/// that of [`systematic`]; `x` the solution.
pub(super) fn sigma(plate: &ThinPlatePrior, x: &[f32], information: &[Information], systematic: &[f32]) -> Vec<f32> {
    let (w, h, n) = (plate.width, plate.height, information.len());
    let local = local(plate, information);
    let scale = prior_scale(plate, x, &local);
    let pooled = |v: &[f32]| mean_over(v, &plate.active, w, h, POOL_RADIUS);
    let (noise, prior) = (pooled(&local.noise), pooled(&local.prior));
    let chi2: Vec<f32> = information.iter().map(|i| i.chi2).collect();
    let misfit = mean_over(&chi2, &plate.active, w, h, NOISE_RADIUS);
    (0..n)
        .into_par_iter()
        .with_min_len(w)
        .map(|i| {
            if !plate.active[i] {
                return f32::NAN;
            }
            (noise[i] * misfit[i] + scale[i] * prior[i] + systematic[i]).sqrt()
        })
        .collect()
}

/// Variances that noise and prior leave in the solution, and their energies on the plate, per pixel.
struct Local {
    noise: Vec<f32>,
    prior: Vec<f32>,
    noise_energy: Vec<f32>,
    /// Of a surface as rough as the plate allows.
    prior_energy: Vec<f32>,
}

/// Means over all spatial frequencies of a uniform plate's lattice, for one ratio ρ of plate weight to information. With s the
/// symbol of the plate, a solution keeps 1/(1 + ρs) of the noise's amplitude at a frequency, and misses ρs/(1 + ρs) of the surface's.
#[derive(Clone, Copy, Default)]
struct Means {
    /// Of 1/(1 + ρs)²: the noise's variance times the information, and the energy of what is seen of the surface.
    noise: f32,
    /// Of ρs/(1 + ρs)²: the prior's variance times the information, and the energy of the noise.
    prior: f32,
}

/// Smallest and largest ln ρ of the table, and its steps a unit.
const RATIOS: [i32; 2] = [-14, 20];
const STEPS: i32 = 4;

/// [`Means`] for every ratio; beyond the last, variances fall as 1/√ρ.
static MEANS: LazyLock<Vec<Means>> = LazyLock::new(|| {
    const N: usize = 96;
    // Finer where s is small, which is what matters for large ρ: frequencies are spaced as squares.
    let node = |i: usize| {
        let u = (i as f64 + 0.5) / N as f64;
        (PI * u * u, 2.0 * u / N as f64)
    };
    let mut symbols = Vec::with_capacity(N * N);
    for i in 0..N {
        for j in 0..N {
            let ((fx, wx), (fy, wy)) = (node(i), node(j));
            let (x, y) = (2.0 - 2.0 * fx.cos(), 2.0 - 2.0 * fy.cos());
            // (x + y)²: the squares of both straight differences, and twice that of the mixed one.
            symbols.push(((x + y).powi(2), wx * wy));
        }
    }
    let total: f64 = symbols.iter().map(|s| s.1).sum();
    (RATIOS[0] * STEPS..=RATIOS[1] * STEPS)
        .map(|step| {
            let ratio = (f64::from(step) / f64::from(STEPS)).exp();
            let mean = |f: &dyn Fn(f64) -> f64| {
                (symbols.iter().map(|(s, weight)| weight * f(ratio * s)).sum::<f64>() / total) as f32
            };
            Means { noise: mean(&|q| (1.0 + q).powi(-2)), prior: mean(&|q| q * (1.0 + q).powi(-2)) }
        })
        .collect()
});

impl Means {
    fn at(ratio: f32) -> Self {
        let place = (ratio.max(f32::MIN_POSITIVE).ln() - RATIOS[0] as f32) * STEPS as f32;
        let place = place.clamp(0.0, (MEANS.len() - 1) as f32 - 1e-3);
        let (a, b, t) = (MEANS[place as usize], MEANS[place as usize + 1], place.fract());
        let mix = |a: f32, b: f32| a + t * (b - a);
        Self { noise: mix(a.noise, b.noise), prior: mix(a.prior, b.prior) }
    }
}

/// Variances and energies of a uniform plate around every pixel.
fn local(plate: &ThinPlatePrior, information: &[Information]) -> Local {
    let (w, h, n) = (plate.width, plate.height, information.len());
    let data: Vec<f32> = information.iter().map(|i| i.h).collect();
    let near = mean_over(&data, &plate.active, w, h, LOCAL_RADIUS);
    let far = mean_over(&data, &plate.active, w, h, FAR_RADIUS);
    // The mean of logarithms: where the plate is broken between two pixels, it is neither whole nor missing.
    let weights: Vec<f32> = (0..n).map(|i| plate.weight(i)).collect();
    let there: Vec<bool> = weights.iter().map(|w| *w > 0.0).collect();
    let logs: Vec<f32> = weights.iter().map(|w| if *w > 0.0 { w.ln() } else { 0.0 }).collect();
    let weight = mean_over(&logs, &there, w, h, LOCAL_RADIUS);
    let mut support: Vec<f32> = plate.active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
    let mut has_weight: Vec<f32> = there.iter().map(|t| if *t { 1.0 } else { 0.0 }).collect();
    box_mean(&mut support, w, h, EDGE_RADIUS);
    box_mean(&mut has_weight, w, h, LOCAL_RADIUS);
    let zero = || vec![0.0f32; n];
    let mut out = Local { noise: zero(), prior: zero(), noise_energy: zero(), prior_energy: zero() };
    for i in (0..n).filter(|i| plate.active[*i]) {
        // A hundredth of what is around reaches a pixel that measures nothing.
        let h = near[i].max(0.01 * far[i]).max(1e-12);
        let weight = if has_weight[i] > 1e-6 { weight[i].exp() } else { 0.0 };
        let means = Means::at(weight / h);
        let edge = 1.0 + EDGE * (2.0 * (1.0 - support[i]).max(0.0)).sqrt();
        out.noise[i] = edge * means.noise / h;
        out.prior[i] = edge * means.prior / h;
        out.noise_energy[i] = means.prior;
        out.prior_energy[i] = means.noise;
    }
    out
}

/// The variance of the surface's true second differences around each pixel, as a part of the plate's own.
///
/// With H the data's information, Q = DᵀWD and Σ = (H + Q)⁻¹, the solution for a true surface of covariance γ Q⁻¹ has the
/// expected energy E = tr(QΣHΣ) + γ tr(HΣHΣ). That is solved for γ.
fn prior_scale(plate: &ThinPlatePrior, x: &[f32], expected: &Local) -> Vec<f32> {
    let around = |mut v: Vec<f32>| {
        box_mean(&mut v, plate.width, plate.height, ROUGHNESS_RADIUS);
        v
    };
    let found = around(plate.energy(x));
    let (noise, prior) = (around(expected.noise_energy.clone()), around(expected.prior_energy.clone()));
    let scale = |i: usize| if prior[i] > 0.0 { ((found[i] - noise[i]) / prior[i]).clamp(0.0, 1.0) } else { 1.0 };
    (0..found.len()).map(scale).collect()
}

/// The variance of the unknown that comes from what is systematic, per pixel of a window of width `w` and height `h`.
///
/// `residuals` and `slopes` are `n × k`: residuals r of the normalized intensities and their slopes g along the unknown, both
/// divided by the noise's standard deviation. Depth has taken from the residuals what lies along g. Of what channel j has across
/// it, means over squares of n pixels have variance 1/n (1 − g_j²/|g|²) from noise alone; what they have above that is shared, and
/// its size s_j² is estimated over the surroundings, where g points elsewhere. It moves the unknown by Σ g_j s_j / |g|².
pub(super) fn systematic(residuals: &[f32], slopes: &[f32], k: usize, active: &[bool], w: usize, h: usize) -> Vec<f32> {
    let n = active.len();
    assert!(residuals.len() == n * k && slopes.len() == n * k && n == w * h, "maps of one size");
    if k < 2 {
        return vec![0.0; n];
    }
    let mut near: Vec<f32> = active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
    box_mean(&mut near, w, h, SHARED_RADIUS);
    let of = |map: &'_ [f32], i: usize| -> f32 { map[i * k..(i + 1) * k].iter().map(|v| v * v).sum() };
    let square: Vec<f32> = (0..n).into_par_iter().map(|i| of(slopes, i)).collect();
    let along: Vec<f32> = (0..n)
        .into_par_iter()
        .map(|i| {
            let gr: f32 = (i * k..(i + 1) * k).map(|j| slopes[j] * residuals[j]).sum();
            if square[i] > 0.0 { gr / square[i] } else { 0.0 }
        })
        .collect();
    let side = (2 * SHARED_RADIUS + 1) as f32;
    // What noise alone leaves by chance, where nothing is shared: half a standard deviation of its mean over as many squares as
    // there are, 0.4 of which remain on average when negative values become 0.
    let squares = ((2 * SYSTEMATIC_RADIUS + 1) as f32 / side).powi(2);
    let chance = 0.5 * (2.0 / squares).sqrt() / (side * side);

    let mut out = vec![0.0f32; n];
    for j in 0..k {
        // One wild pixel (a highlight, an edge) is not what its neighbors share.
        let across = |i: usize| (residuals[i * k + j] - slopes[i * k + j] * along[i]).clamp(-10.0, 10.0);
        let own: Vec<f32> = (0..n).into_par_iter().map(|i| if active[i] { across(i) } else { 0.0 }).collect();
        let mut mean = own.clone();
        box_mean(&mut mean, w, h, SHARED_RADIUS);
        let (mut excess, mut seen) = (vec![0.0f32; n], vec![0.0f32; n]);
        for i in (0..n).filter(|i| active[*i] && square[*i] > 0.0) {
            let shared = (mean[i] / near[i]).powi(2);
            // The share of noise in the mean, from the residuals' own spread: a wrong noise level does not look systematic.
            let pixels = near[i] * side * side;
            let white = (own[i] * own[i] - shared) / (pixels - 1.0).max(1.0);
            excess[i] = shared - white;
            seen[i] = 1.0 - slopes[i * k + j].powi(2) / square[i];
        }
        box_mean(&mut excess, w, h, SYSTEMATIC_RADIUS);
        box_mean(&mut seen, w, h, SYSTEMATIC_RADIUS);
        for i in (0..n).filter(|i| active[*i] && square[*i] > 0.0) {
            let size = (excess[i] / seen[i].max(0.05) - chance).max(0.0);
            out[i] += size * (slopes[i * k + j] / square[i]).powi(2);
        }
    }
    out
}

/// Means over squares of a map, of the pixels that count.
fn mean_over(v: &[f32], active: &[bool], w: usize, h: usize, radius: usize) -> Vec<f32> {
    let mut sum: Vec<f32> = v.iter().zip(active).map(|(v, a)| if *a { *v } else { 0.0 }).collect();
    let mut count: Vec<f32> = active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
    box_mean(&mut sum, w, h, radius);
    box_mean(&mut count, w, h, radius);
    sum.iter().zip(&count).map(|(s, c)| if *c > 0.0 { s / c } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::super::thin_plate::StopCriterion;
    use super::*;

    fn normals(n: usize, seed: u64) -> Vec<f32> {
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    fn window(w: usize, h: usize) -> Vec<bool> {
        (0..w * h).map(|i| i % w > 0 && i % w + 1 < w && i / w > 0 && i / w + 1 < h).collect()
    }

    /// Noise that neighbors do not share is none of it, whatever its level; an offset that they share moves the unknown by as
    /// much as it says, whichever channel it is in.
    #[test]
    fn what_neighbors_share_is_told_from_noise() {
        let (w, h, k) = (128, 112, 3);
        let (n, active) = (w * h, window(128, 112));
        let noise = normals(n * k, 1);
        // Slopes of 2 that turn through code space, as those of a sine do.
        let slopes: Vec<f32> = (0..n * k).map(|i| 2.0 * ((i / k) as f32 * 0.1 + (i % k) as f32 * 2.0).sin()).collect();
        let inner: Vec<usize> =
            (0..n).filter(|i| (20..w - 20).contains(&(i % w)) && (20..h - 20).contains(&(i / w))).collect();
        let mean = |v: &[f32]| inner.iter().map(|i| v[*i]).sum::<f32>() / inner.len() as f32;
        let across = |r: &[f32]| -> Vec<f32> {
            // What is left when the unknown has taken its part, and the variance of that part.
            let mut left = r.to_vec();
            for (r, g) in left.chunks_exact_mut(k).zip(slopes.chunks_exact(k)) {
                let gg: f32 = g.iter().map(|g| g * g).sum();
                let part = r.iter().zip(g).map(|(r, g)| r * g).sum::<f32>() / gg;
                r.iter_mut().zip(g).for_each(|(r, g)| *r -= part * g);
            }
            left
        };
        for level in [1.0f32, 1.5] {
            let white: Vec<f32> = noise.iter().map(|v| level * v).collect();
            let quiet = mean(&systematic(&across(&white), &slopes, k, &active, w, h));
            for channel in 0..k {
                let offset = |i: usize| if i % k == channel { 0.8 * ((i / k % w) as f32 * 0.05).cos() } else { 0.0 };
                let r: Vec<f32> = white.iter().enumerate().map(|(i, v)| v + offset(i)).collect();
                let found = mean(&systematic(&across(&r), &slopes, k, &active, w, h));
                let moved: Vec<f32> = (0..n)
                    .map(|i| {
                        let g = &slopes[i * k..(i + 1) * k];
                        let gg: f32 = g.iter().map(|g| g * g).sum();
                        (g[channel] * offset(i * k + channel) / gg).powi(2)
                    })
                    .collect();
                let expected = mean(&moved);
                assert!(quiet < 0.1 * expected, "{quiet} of {expected}");
                assert!((found / expected - 1.0).abs() < 0.4, "{found} {expected}");
            }
        }
    }

    /// Surfaces of known roughness under known noise: errors of the solution are as large as it says, whether the surface is
    /// as rough as the plate allows, smoother, or flat.
    #[test]
    fn sigma_is_that_of_the_errors_whatever_the_roughness() {
        let (w, h) = (120, 100);
        let active = window(w, h);
        let n = w * h;
        for (case, part) in [1.0f32, 0.2, 0.0].into_iter().enumerate() {
            let mut plate = ThinPlatePrior::new(w, h, active.clone());
            plate.reweight(&vec![0.0; n], 0.1, 0.5, 3);
            let weak = vec![1e-4f32; n];
            // A surface drawn from the plate itself, `part` as rough.
            let eps = normals(3 * n, 7 + case as u64);
            let mut at = 0;
            let b: Vec<f32> = plate
                .noise(|| {
                    at += 1;
                    eps[at % eps.len()]
                })
                .into_iter()
                .map(|v| v * part)
                .collect();
            let mut truth = vec![0.0f32; n];
            plate.solve(&weak, &b, &mut truth, StopCriterion { reduction: 1e-6, iterations: 4000 });
            // Measured with noise of variance 1/h.
            let info: Vec<Information> =
                active.iter().map(|a| Information { h: if *a { 0.5 } else { 0.0 }, chi2: 1.0 }).collect();
            let data: Vec<f32> = info.iter().map(|i| i.h).collect();
            let noise = normals(n, 31 + case as u64);
            let b: Vec<f32> = (0..n).map(|i| data[i] * truth[i] + data[i].sqrt() * noise[i]).collect();
            let mut x = vec![0.0f32; n];
            plate.solve(&data, &b, &mut x, StopCriterion { reduction: 1e-6, iterations: 4000 });
            let s = sigma(&plate, &x, &info, &vec![0.0; n]);
            let inner: Vec<usize> =
                (0..n).filter(|i| (8..w - 8).contains(&(i % w)) && (8..h - 8).contains(&(i / w))).collect();
            let within = inner.iter().filter(|i| (x[**i] - truth[**i]).abs() <= s[**i]).count();
            let share = within as f64 / inner.len() as f64;
            // A few hundred independent patches, whose roughness is estimated: within a tenth.
            assert!((share - 0.683).abs() < 0.1, "{part}: {share}");
        }
    }
}
