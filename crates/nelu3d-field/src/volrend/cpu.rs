//! Fast form: rays in parallel, sums in double precision (the exponentials cost more than the width does).
//!
//! Buffers are split along a fixed binary tree over rays, so that sums over rays do not depend on threads.

/// Φ(f) = sigmoid(x) of one sample, x = inv_s f, in the pieces that ratios and slopes are made of: one exponential, and
/// finite for every finite x.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Phi {
    /// min(x, 0): log Φ = base − log(factor).
    base: f64,
    /// 1 + e^−|x|
    factor: f64,
    /// 1 − Φ
    complement: f64,
}

impl Phi {
    #[inline(always)]
    fn new(x: f64) -> Self {
        let e = (-x.abs()).exp();
        let factor = 1.0 + e;
        Self { base: x.min(0.0), factor, complement: if x < 0.0 { 1.0 } else { e } / factor }
    }

    /// Returns 1 − alpha = min(1, Φ(next) / Φ(self)).
    #[inline(always)]
    fn passed(self, next: Self) -> f64 {
        let power = next.base - self.base;
        let ratio = self.factor / next.factor;
        (if power == 0.0 { ratio } else { power.exp() * ratio }).min(1.0)
    }
}

/// A sample, and the interval it opens.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    phi: Phi,
    /// 1 − alpha
    passed: f64,
    /// Transmittance after the interval.
    transmittance: f64,
}

/// Writes the weights of one ray's samples; `steps` is what [`backward_ray`] needs of them.
#[inline(always)]
pub(crate) fn forward_ray(sdf: &[f32], inv_s: f64, weights: &mut [f32], steps: &mut Vec<Step>) {
    weights.fill(0.0);
    steps.clear();
    let mut transmittance = 1.0;
    for (j, &f) in sdf.iter().enumerate() {
        let phi = Phi::new(inv_s * f as f64);
        if let Some(step) = steps.last_mut() {
            step.passed = step.phi.passed(phi);
            weights[j - 1] = (transmittance * (1.0 - step.passed)) as f32;
            transmittance *= step.passed;
            step.transmittance = transmittance;
        }
        steps.push(Step { phi, passed: 1.0, transmittance });
    }
}

/// Returns log T behind a ray's last sample, no less than that of the smallest normal number.
#[inline(always)]
pub(crate) fn log_transmittance(steps: &[Step]) -> f64 {
    steps.last().map_or(0.0, |s| s.transmittance.max(f64::MIN_POSITIVE).ln())
}

/// Writes the gradient of one ray's signed distances and returns that of `inv_s`, given that of the weights and that of
/// [`log_transmittance`].
#[inline(always)]
pub(crate) fn backward_ray(
    sdf: &[f32],
    inv_s: f64,
    weights: &[f32],
    steps: &[Step],
    d_weights: &[f32],
    d_log_transmittance: f64,
    d_sdf: &mut [f32],
) -> f64 {
    // Σ_{l>j} w_l g_l, back to front, and ∂L/∂Δ of the interval that a sample opens and of the one it closes.
    let (mut after, mut opened) = (0.0, 0.0);
    let mut d_inv_s = 0.0;
    for j in (0..sdf.len()).rev() {
        let mut closed = 0.0;
        if j > 0 {
            after += weights[j] as f64 * d_weights[j] as f64;
            // No gradient where the clamp to alpha >= 0 acts.
            if steps[j - 1].passed < 1.0 {
                closed = after - steps[j - 1].transmittance * d_weights[j - 1] as f64 + d_log_transmittance;
            }
        }
        let slope = (closed - opened) * steps[j].phi.complement;
        d_sdf[j] = (slope * inv_s) as f32;
        d_inv_s += slope * sdf[j] as f64;
        opened = closed;
    }
    d_inv_s
}

/// Samples below which a part of the rays is not split further.
const GRAIN: usize = 4096;

fn check(offsets: &[usize], n_samples: usize) {
    assert!(offsets.first() == Some(&0) && offsets.last() == Some(&n_samples), "offsets must run from 0 to n_samples");
    assert!(offsets.is_sorted(), "offsets must not decrease");
}

/// Returns where to split the rays in two, or `None` for a part small enough.
fn middle(offsets: &[usize]) -> Option<usize> {
    let n_rays = offsets.len() - 1;
    (n_rays > 1 && offsets[n_rays] - offsets[0] > GRAIN).then_some(n_rays / 2)
}

/// Writes the weights of all samples. `offsets`: first sample of every ray and, last, the number of samples; `sdf`,
/// `weights`: per sample.
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
        let mut steps = Vec::new();
        for ray in offsets.windows(2) {
            let weights = &mut weights[ray[0] - start..ray[1] - start];
            forward_ray(&sdf[ray[0]..ray[1]], inv_s, weights, &mut steps);
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
        let mut d_inv_s = 0.0;
        let (mut again, mut steps) = (Vec::new(), Vec::new());
        for ray in offsets.windows(2) {
            let range = ray[0]..ray[1];
            let d_sdf = &mut d_sdf[ray[0] - start..ray[1] - start];
            let (sdf, d_weights) = (&s.sdf[range.clone()], &s.d_weights[range.clone()]);
            again.resize(sdf.len(), 0.0);
            forward_ray(sdf, s.inv_s, &mut again, &mut steps);
            d_inv_s += backward_ray(sdf, s.inv_s, &s.weights[range], &steps, d_weights, 0.0, d_sdf);
        }
        d_inv_s
    }
    let n = sdf.len();
    assert!(n == weights.len() && n == d_weights.len() && n == d_sdf.len());
    check(offsets, n);
    part(offsets, &Samples { sdf, inv_s: inv_s as f64, weights, d_weights }, d_sdf)
}

/// Writes the opacity of every ray, Σ_j w_j.
pub fn opacity(offsets: &[usize], weights: &[f32], out: &mut [f32]) {
    check(offsets, weights.len());
    assert_eq!(out.len() + 1, offsets.len());
    for (ray, out) in offsets.windows(2).zip(out) {
        *out = weights[ray[0]..ray[1]].iter().map(|&w| w as f64).sum::<f64>() as f32;
    }
}

/// Writes Σ_j w_j values\[j\]\[c\] of every ray: `values[sample][k]`, `out[ray][k]`.
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

/// Adds to the gradients of weights and values, given that of the sums. Shapes as in [`accumulate`]; an empty
/// `d_values` is not written (values that are frozen).
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
