//! The three parts of the uncertainty together.

use rayon::prelude::*;

use super::information::Information;
use super::masked_mean::masked_mean;
use super::posterior::Posterior;
use super::systematic::Systematic;
use crate::reconstruct::refine::thin_plate::ThinPlatePrior;

/// Radius over which the variances of neighbors are averaged, px.
const POOL_RADIUS: usize = 2;
/// Radius over which residuals tell how large the noise really is, px.
const NOISE_RADIUS: usize = 8;
/// Least slope of the influence that is believed: where residuals are far beyond noise, nothing is.
const MIN_SLOPE: f32 = 0.1;

/// The noise's variance over that of a plate whose floor stands still, where the floor was set to the roughness of the
/// surface: what noise has bent makes the plate looser there. Scans of the presets' scenes that differ by their noise
/// alone differ by 1.1 to 1.7 times the variance of a plate where the floor's is 0.012 to 0.2 of what it may be, and by
/// 0.9 to 1.0 times that where it is at one of its bounds.
const FOLLOWING: f32 = 1.4;
/// Part of what a surface of white curvature would lose to the prior that surfaces lose whose floor is at its lowest. What
/// is as smooth as that has its curvature at lower frequencies. What the same scans have in common is off by 0.1 to 0.3
/// times the prior's variance there, by 0.45 and more of it where the floor is at its highest.
const SMOOTH: f32 = 0.3;

/// Largest ratio of a surface's roughness to the prior's that is believed beside an edge of the surface, where bodies bend
/// out of sight. Farther in it is 1: what neighbors share of errors looks like shape.
const MOST_AT_EDGE: f32 = 16.0;

/// Returns the ratio of the noise's variance around each pixel to that of its model, as residuals show it.
pub fn noise_ratio(prior: &ThinPlatePrior, information: &[Information]) -> Vec<f32> {
    let mean = |of: fn(&Information) -> f32| {
        let map: Vec<f32> = information.iter().map(of).collect();
        masked_mean(&map, &prior.active, prior.width, prior.height, NOISE_RADIUS)
    };
    let (influence, slope) = (mean(|i| i.influence), mean(|i| i.slope));
    influence.iter().zip(&slope).map(|(influence, slope)| influence / slope.max(MIN_SLOPE)).collect()
}

/// Returns one standard deviation of the unknown per pixel of the prior's window; NaN where there is no surface. `x` is
/// the solution, `posterior` what noise and prior leave in it, `systematic` what neighbors share of the residuals,
/// which is no noise; `factor` tells how much more depths scatter at a pixel that average over so many pixels than
/// their χ² says. What makes them scatter more, errors of the color field above all, is seen in the systematic part
/// too, and what more noise there is where the prior follows the surface is in the boards' factor in part: the largest of
/// the three is added.
pub fn sigma(
    prior: &ThinPlatePrior,
    posterior: &Posterior,
    x: &[f32],
    information: &[Information],
    systematic: &Systematic,
    factor: impl Fn(usize, f32) -> f32 + Sync,
) -> Vec<f32> {
    let (w, h, n) = (prior.width, prior.height, information.len());
    let pooled = |v: &[f32]| masked_mean(v, &prior.active, w, h, POOL_RADIUS);
    let (noise, smoothing) = (pooled(&posterior.noise), pooled(&posterior.prior));
    let mut noise_ratio = noise_ratio(prior, information);
    let factor = |i: usize| if prior.active[i] { factor(i, posterior.pixels[i]) } else { 1.0 };
    let factors: Vec<f32> = (0..n).into_par_iter().map(factor).collect();
    let mut following = vec![1.0; n];
    for i in (0..n).filter(|i| prior.active[*i]) {
        following[i] = if prior.floor_follows(i) { FOLLOWING } else { 1.0 };
        noise_ratio[i] *= systematic.unshared[i] * factors[i];
    }
    let noise_in_solution: Vec<f32> = noise_ratio.iter().zip(&following).map(|(ratio, more)| ratio * more).collect();
    let scale = posterior.prior_scale(prior, x, &noise_in_solution, 0.0);
    (0..n)
        .into_par_iter()
        .with_min_len(w)
        .map(|i| {
            if !prior.active[i] {
                return f32::NAN;
            }
            let of_noise = noise[i] * noise_ratio[i] / factors[i];
            let by_boards = noise[i] * noise_ratio[i] - of_noise;
            let more = by_boards.max(systematic.variance[i]).max((following[i] - 1.0) * of_noise);
            let white = SMOOTH + (1.0 - SMOOTH) * prior.floor_part(i);
            let most = if posterior.is_beside_edge(i) { MOST_AT_EDGE } else { 1.0 };
            (of_noise + more + scale[i].min(most) * white * smoothing[i]).sqrt()
        })
        .collect()
}
