//! The variance of depth that comes from systematic errors, which neighbors share.

use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

/// Radius of the squares that share a systematic error, px: about what the prior averages over.
const SHARED_RADIUS: usize = 2;
/// Radius over which the size of systematic errors is estimated, px.
const SYSTEMATIC_RADIUS: usize = 16;

/// Returns the variance of the unknown that comes from systematic errors, per pixel of a window of width `w` and height
/// `h`.
///
/// `residuals` and `slopes` are `n × k`: residuals r of the normalized intensities and their slopes g along the
/// unknown, both divided by the noise's standard deviation. Depth has taken from the residuals what lies along g. What
/// channel j has across g has, averaged over squares of n pixels, variance 1/n (1 − g_j²/|g|²) from noise alone. Any
/// variance above that is shared; its size s_j² is estimated over the surroundings, where g points elsewhere. It
/// changes the unknown by Σ g_j s_j / |g|².
pub(in crate::reconstruct::refine) fn systematic(
    residuals: &[f32],
    slopes: &[f32],
    k: usize,
    active: &[bool],
    w: usize,
    h: usize,
) -> Vec<f32> {
    let n = active.len();
    assert!(residuals.len() == n * k && slopes.len() == n * k && n == w * h, "maps of one size");
    if k < 2 {
        return vec![0.0; n];
    }
    let mut near: Vec<f32> = active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
    box_mean(&mut near, w, h, SHARED_RADIUS);
    let squared_norm = |map: &'_ [f32], i: usize| -> f32 { map[i * k..(i + 1) * k].iter().map(|v| v * v).sum() };
    let square: Vec<f32> = (0..n).into_par_iter().map(|i| squared_norm(slopes, i)).collect();
    let along: Vec<f32> = (0..n)
        .into_par_iter()
        .map(|i| {
            let gr: f32 = (i * k..(i + 1) * k).map(|j| slopes[j] * residuals[j]).sum();
            if square[i] > 0.0 { gr / square[i] } else { 0.0 }
        })
        .collect();
    let side = (2 * SHARED_RADIUS + 1) as f32;
    // Excess that noise alone has by chance, where nothing is shared: half a standard deviation of its mean over as
    // many squares as there are, 0.4 of which remain on average when negative values become 0.
    let squares = ((2 * SYSTEMATIC_RADIUS + 1) as f32 / side).powi(2);
    let chance = 0.5 * (2.0 / squares).sqrt() / (side * side);

    let mut out = vec![0.0f32; n];
    for j in 0..k {
        // A single outlier (a highlight, an edge) is not what its neighbors share.
        let across = |i: usize| (residuals[i * k + j] - slopes[i * k + j] * along[i]).clamp(-10.0, 10.0);
        let own: Vec<f32> = (0..n).into_par_iter().map(|i| if active[i] { across(i) } else { 0.0 }).collect();
        let mut mean = own.clone();
        box_mean(&mut mean, w, h, SHARED_RADIUS);
        let (mut excess, mut visible) = (vec![0.0f32; n], vec![0.0f32; n]);
        for i in (0..n).filter(|i| active[*i] && square[*i] > 0.0) {
            let shared = (mean[i] / near[i]).powi(2);
            // Variance of the mean from noise, by the residuals' own spread: a wrong noise level does not look
            // systematic.
            let pixels = near[i] * side * side;
            let noise = (own[i] * own[i] - shared) / (pixels - 1.0).max(1.0);
            excess[i] = shared - noise;
            visible[i] = 1.0 - slopes[i * k + j].powi(2) / square[i];
        }
        box_mean(&mut excess, w, h, SYSTEMATIC_RADIUS);
        box_mean(&mut visible, w, h, SYSTEMATIC_RADIUS);
        for i in (0..n).filter(|i| active[*i] && square[*i] > 0.0) {
            let size = (excess[i] / visible[i].max(0.05) - chance).max(0.0);
            out[i] += size * (slopes[i * k + j] / square[i]).powi(2);
        }
    }
    out
}
