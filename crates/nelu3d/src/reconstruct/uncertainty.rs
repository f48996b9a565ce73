//! How far to trust each depth: one standard deviation, from what the method knows without a truth.
//!
//! Three parts, added as variances:
//!
//! 1. the sensor's noise, as large as the residuals show it, carried through the last linear system by random draws;
//! 2. what the thin plate smooths away, by draws from its prior, scaled by how rough the found surface really is: the plate allows
//!    every surface a least roughness, and many are smoother;
//! 3. what is systematic: light that no part of the model explains (cross-talk of colors, errors of the color field, light by
//!    way of other surfaces). It differs from noise in that neighbors share it, so averaging over the plate does not remove it. It
//!    is seen in the directions of code space that depth cannot explain, channel by channel, and taken to be as large where it is not.

use rand::SeedableRng;
use rayon::prelude::*;

use super::smooth::box_mean;
use super::thin_plate::{Plate, Until};

/// Draws that are solved together, half of them of noise and half of the prior.
const LANES: usize = 4;

/// Radius over which variances of draws are pooled, px.
const POOL_RADIUS: usize = 2;
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
/// that of [`systematic`]; `x` the solution; `draws` how many there are and the most iterations of their solution.
pub(super) fn sigma(
    plate: &Plate,
    x: &[[f32; 1]],
    information: &[Information],
    systematic: &[f32],
    draws: [usize; 2],
    seed: u64,
) -> Vec<f32> {
    let (w, h, n) = (plate.width, plate.height, information.len());
    let drawn = draw(plate, information, draws, seed);
    let scale = prior_scale(plate, x, &drawn);
    let pooled = |v: &[f32]| mean_over(v, &plate.active, w, h, POOL_RADIUS);
    let (noise, prior) = (pooled(&drawn.noise), pooled(&drawn.prior));
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

/// Variances of draws and their energies on the plate, per pixel.
struct Drawn {
    noise: Vec<f32>,
    prior: Vec<f32>,
    noise_energy: Vec<f32>,
    prior_energy: Vec<f32>,
}

/// Solutions of the last linear system for random right-hand sides with the covariance of the data's noise, and of the prior.
fn draw(plate: &Plate, information: &[Information], [draws, iterations]: [usize; 2], seed: u64) -> Drawn {
    use rand_distr::{Distribution, StandardNormal};
    let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
    let h: Vec<f32> = information.iter().map(|i| i.h).collect();
    let n = h.len();
    let zero = || vec![0.0f32; n];
    let mut out = Drawn { noise: zero(), prior: zero(), noise_energy: zero(), prior_energy: zero() };
    let rounds = draws.div_ceil(LANES).max(1);
    let each = 1.0 / (rounds * LANES / 2) as f32;
    for _ in 0..rounds {
        let mut b = vec![[0.0f32; LANES]; n];
        for lane in 0..LANES {
            let mut normal = || -> f32 { StandardNormal.sample(&mut rng) };
            if lane % 2 == 0 {
                for i in (0..n).filter(|i| plate.active[*i]) {
                    b[i][lane] = h[i].sqrt() * normal();
                }
            } else {
                let noise = plate.noise(&mut normal);
                b.iter_mut().zip(noise).for_each(|(b, v)| b[lane] = v);
            }
        }
        let mut y = vec![[0.0; LANES]; n];
        // A tenth of a percent in the solution is far below the scatter of a dozen draws.
        plate.solve(&h, &b, &mut y, Until { reduction: 1e-3, iterations });
        for lane in 0..LANES {
            let one: Vec<[f32; 1]> = y.iter().map(|y| [y[lane]]).collect();
            let (variance, energy) = match lane % 2 {
                0 => (&mut out.noise, &mut out.noise_energy),
                _ => (&mut out.prior, &mut out.prior_energy),
            };
            variance.iter_mut().zip(&one).for_each(|(s, y)| *s += each * y[0] * y[0]);
            energy.iter_mut().zip(plate.energy(&one)).for_each(|(s, e)| *s += each * e);
        }
    }
    out
}

/// The variance of the surface's true second differences around each pixel, as a part of the plate's own.
///
/// With H the data's information, Q = DᵀWD and Σ = (H + Q)⁻¹, the solution for a true surface of covariance γ Q⁻¹ has the
/// expected energy E = tr(QΣHΣ) + γ (n − tr(QΣQΣ) − 2 tr(QΣHΣ)), n pixels; the two traces are the energies of the draws of
/// noise and of prior. That is solved for γ.
fn prior_scale(plate: &Plate, x: &[[f32; 1]], drawn: &Drawn) -> Vec<f32> {
    let (w, h) = (plate.width, plate.height);
    let local = |v: Vec<f32>| {
        let mut v = v;
        box_mean(&mut v, w, h, ROUGHNESS_RADIUS);
        v
    };
    let found = local(plate.energy(x));
    let (noise, prior) = (local(drawn.noise_energy.clone()), local(drawn.prior_energy.clone()));
    let count = local(plate.active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect());
    (0..found.len())
        .map(|i| {
            let free = count[i] - prior[i] - 2.0 * noise[i];
            // Where the data say next to nothing about roughness, the prior stands.
            if free > 0.02 * count[i] { ((found[i] - noise[i]) / free).clamp(0.0, 1.0) } else { 1.0 }
        })
        .collect()
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
    use rand_distr::{Distribution, StandardNormal};

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
            let mut plate = Plate::new(w, h, active.clone());
            plate.reweight(&vec![[0.0]; n], 0.1, 0.5, 3);
            let weak = vec![1e-4f32; n];
            // A surface drawn from the plate itself, `part` as rough.
            let eps = normals(3 * n, 7 + case as u64);
            let mut at = 0;
            let b: Vec<[f32; 1]> = plate
                .noise(|| {
                    at += 1;
                    eps[at % eps.len()]
                })
                .into_iter()
                .map(|v| [v * part])
                .collect();
            let mut truth = vec![[0.0f32]; n];
            plate.solve(&weak, &b, &mut truth, Until { reduction: 1e-6, iterations: 4000 });
            // Measured with noise of variance 1/h.
            let info: Vec<Information> =
                active.iter().map(|a| Information { h: if *a { 0.5 } else { 0.0 }, chi2: 1.0 }).collect();
            let data: Vec<f32> = info.iter().map(|i| i.h).collect();
            let noise = normals(n, 31 + case as u64);
            let b: Vec<[f32; 1]> = (0..n).map(|i| [data[i] * truth[i][0] + data[i].sqrt() * noise[i]]).collect();
            let mut x = vec![[0.0f32]; n];
            plate.solve(&data, &b, &mut x, Until { reduction: 1e-6, iterations: 4000 });
            let s = sigma(&plate, &x, &info, &vec![0.0; n], [24, 400], 3);
            let inner: Vec<usize> =
                (0..n).filter(|i| (8..w - 8).contains(&(i % w)) && (8..h - 8).contains(&(i / w))).collect();
            let within = inner.iter().filter(|i| (x[**i][0] - truth[**i][0]).abs() <= s[**i]).count();
            let share = within as f64 / inner.len() as f64;
            // A few hundred independent patches, whose roughness is estimated: within a tenth.
            assert!((share - 0.683).abs() < 0.1, "{part}: {share}");
        }
    }
}
