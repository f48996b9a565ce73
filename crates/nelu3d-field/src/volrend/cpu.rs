//! Fast form: rays in parallel, sums in double precision (the exponentials cost more than the width does).
//!
//! Buffers are split along a fixed binary tree over rays, so that sums over rays do not depend on threads.

use crate::Real;

/// Samples below which a part of the rays is not split further.
const GRAIN: usize = 4096;

fn check(offsets: &[usize], n_samples: usize) {
    assert!(offsets.first() == Some(&0) && offsets.last() == Some(&n_samples), "offsets must run from 0 to n_samples");
    assert!(offsets.is_sorted(), "offsets must not decrease");
}

/// Where to split the rays in two, or `None` for a part small enough.
fn middle(offsets: &[usize]) -> Option<usize> {
    let n_rays = offsets.len() - 1;
    (n_rays > 1 && offsets[n_rays] - offsets[0] > GRAIN).then_some(n_rays / 2)
}

/// Weights of all samples. `offsets`: first sample of every ray and, last, the number of samples; `sdf`, `weights`: per
/// sample.
///
/// # Panics
/// If the offsets or the lengths do not fit.
pub fn render_weights(offsets: &[usize], sdf: &[f32], inv_s: f32, weights: &mut [f32]) {
    fn part(offsets: &[usize], sdf: &[f32], inv_s: f64, weights: &mut [f32]) {
        let start = offsets[0];
        if let Some(middle) = middle(offsets) {
            let (left, right) = weights.split_at_mut(offsets[middle] - start);
            rayon::join(|| part(&offsets[..=middle], sdf, inv_s, left), || part(&offsets[middle..], sdf, inv_s, right));
            return;
        }
        for ray in offsets.windows(2) {
            let sdf = &sdf[ray[0]..ray[1]];
            let weights = &mut weights[ray[0] - start..ray[1] - start];
            weights.fill(0.0);
            let Some(&first) = sdf.first() else { continue };
            let mut log_phi = (inv_s * first as f64).log_sigmoid();
            let mut transmittance = 1.0;
            for (w, &next) in weights.iter_mut().zip(&sdf[1..]) {
                let next = (inv_s * next as f64).log_sigmoid();
                let alpha = -(next - log_phi).min(0.0).exp_m1();
                *w = (transmittance * alpha) as f32;
                transmittance *= 1.0 - alpha;
                log_phi = next;
            }
        }
    }
    assert_eq!(sdf.len(), weights.len());
    check(offsets, sdf.len());
    part(offsets, sdf, inv_s as f64, weights);
}

/// Writes the gradient of all signed distances and returns that of `inv_s`, given that of the weights. `weights` are
/// those of [`render_weights`].
///
/// # Panics
/// If the offsets or the lengths do not fit.
pub fn render_weights_backward(
    offsets: &[usize],
    sdf: &[f32],
    inv_s: f32,
    weights: &[f32],
    d_weights: &[f32],
    d_sdf: &mut [f32],
) -> f64 {
    struct Samples<'a> {
        sdf: &'a [f32],
        inv_s: f64,
        weights: &'a [f32],
        d_weights: &'a [f32],
    }
    fn part(offsets: &[usize], s: &Samples, d_sdf: &mut [f32]) -> f64 {
        let start = offsets[0];
        if let Some(middle) = middle(offsets) {
            let (left, right) = d_sdf.split_at_mut(offsets[middle] - start);
            let (a, b) = rayon::join(|| part(&offsets[..=middle], s, left), || part(&offsets[middle..], s, right));
            return a + b;
        }
        let inv_s = s.inv_s;
        let mut d_inv_s = 0.0;
        for ray in offsets.windows(2) {
            let range = ray[0]..ray[1];
            let (sdf, weights, d_weights) = (&s.sdf[range.clone()], &s.weights[range.clone()], &s.d_weights[range]);
            let d_sdf = &mut d_sdf[ray[0] - start..ray[1] - start];
            d_sdf.fill(0.0);
            let Some(&first) = sdf.first() else { continue };
            // Front to back, with Σ_{l>j} w_l g_l as the total less what was passed: in double precision what cancels
            // is far below the single precision of the result.
            let mut after: f64 = weights.iter().zip(d_weights).map(|(&w, &g)| w as f64 * g as f64).sum();
            let mut transmittance = 1.0;
            let mut x = inv_s * first as f64;
            let mut pending = 0.0;
            for j in 0..sdf.len() - 1 {
                let next = inv_s * sdf[j + 1] as f64;
                let delta = next.log_sigmoid() - x.log_sigmoid();
                let g = d_weights[j] as f64;
                after -= weights[j] as f64 * g;
                let mut d_delta = 0.0;
                if delta < 0.0 {
                    transmittance *= delta.exp();
                    d_delta = after - transmittance * g;
                }
                // Sample j closes interval j − 1 (pending) and opens interval j.
                let slope = (pending - d_delta) * (-x).sigmoid();
                d_sdf[j] = (slope * inv_s) as f32;
                d_inv_s += slope * sdf[j] as f64;
                pending = d_delta;
                x = next;
            }
            let last = sdf.len() - 1;
            let slope = pending * (-x).sigmoid();
            d_sdf[last] = (slope * inv_s) as f32;
            d_inv_s += slope * sdf[last] as f64;
        }
        d_inv_s
    }
    let n = sdf.len();
    assert!(n == weights.len() && n == d_weights.len() && n == d_sdf.len());
    check(offsets, n);
    part(offsets, &Samples { sdf, inv_s: inv_s as f64, weights, d_weights }, d_sdf)
}

/// Opacity of every ray, Σ_j w_j.
pub fn opacity(offsets: &[usize], weights: &[f32], out: &mut [f32]) {
    check(offsets, weights.len());
    assert_eq!(out.len() + 1, offsets.len());
    for (ray, out) in offsets.windows(2).zip(out) {
        *out = weights[ray[0]..ray[1]].iter().map(|&w| w as f64).sum::<f64>() as f32;
    }
}

/// Σ_j w_j values\[j\]\[c\] of every ray: `values[sample][k]`, `out[ray][k]`.
///
/// # Panics
/// If the offsets or the lengths do not fit.
pub fn accumulate(offsets: &[usize], weights: &[f32], values: &[f32], k: usize, out: &mut [f32]) {
    check(offsets, weights.len());
    assert!(k > 0 && values.len() == weights.len() * k && out.len() == (offsets.len() - 1) * k);
    for (ray, out) in offsets.windows(2).zip(out.chunks_exact_mut(k)) {
        for (c, out) in out.iter_mut().enumerate() {
            *out = (ray[0]..ray[1]).map(|j| weights[j] as f64 * values[j * k + c] as f64).sum::<f64>() as f32;
        }
    }
}

/// Adds to the gradients of weights and values, given that of the sums. Shapes as in [`accumulate`]; an empty `d_values`
/// is not written (values that are frozen).
///
/// # Panics
/// If the offsets or the lengths do not fit.
pub fn accumulate_backward(
    offsets: &[usize],
    weights: &[f32],
    values: &[f32],
    d_out: &[f32],
    k: usize,
    d_weights: &mut [f32],
    d_values: &mut [f32],
) {
    check(offsets, weights.len());
    assert!(k > 0 && values.len() == weights.len() * k && d_out.len() == (offsets.len() - 1) * k);
    assert!(d_weights.len() == weights.len() && (d_values.is_empty() || d_values.len() == values.len()));
    for (ray, d_out) in offsets.windows(2).zip(d_out.chunks_exact(k)) {
        for j in ray[0]..ray[1] {
            d_weights[j] += d_out.iter().zip(&values[j * k..]).map(|(d, v)| d * v).sum::<f32>();
            if !d_values.is_empty() {
                for (d_value, d) in d_values[j * k..].iter_mut().zip(d_out) {
                    *d_value += d * weights[j];
                }
            }
        }
    }
}
