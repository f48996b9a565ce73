//! Plain form, one ray at a time.

use crate::Real;

/// Returns Δ_j of an interval, and whether the clamp to alpha >= 0 acts.
fn log_ratio<T: Real>(f: T, next: T, inv_s: T) -> (T, bool) {
    let delta = (inv_s * next).log_sigmoid() - (inv_s * f).log_sigmoid();
    (delta.min(T::of(0.0)), delta >= T::of(0.0))
}

/// Writes the weights of one ray's samples; the last is 0.
pub fn render_weights<T: Real>(sdf: &[T], inv_s: T, weights: &mut [T]) {
    assert_eq!(sdf.len(), weights.len());
    weights.fill(T::of(0.0));
    let mut log_transmittance = T::of(0.0);
    for j in 0..sdf.len().saturating_sub(1) {
        let (delta, _) = log_ratio(sdf[j], sdf[j + 1], inv_s);
        weights[j] = log_transmittance.exp() * -delta.exp_m1();
        log_transmittance += delta;
    }
}

/// Returns log T behind a ray's last sample, Σ_j Δ_j.
pub fn log_transmittance<T: Real>(sdf: &[T], inv_s: T) -> T {
    sdf.windows(2).map(|f| log_ratio(f[0], f[1], inv_s).0).sum()
}

/// Writes the gradient of one ray's signed distances and returns that of `inv_s`, given that of the weights and that of
/// [`log_transmittance`].
pub fn render_weights_backward<T: Real>(
    sdf: &[T],
    inv_s: T,
    d_weights: &[T],
    d_log_transmittance: T,
    d_sdf: &mut [T],
) -> T {
    assert!(sdf.len() == d_weights.len() && sdf.len() == d_sdf.len());
    let zero = T::of(0.0);
    d_sdf.fill(zero);
    let n = sdf.len().saturating_sub(1);
    let mut weights = vec![zero; sdf.len()];
    render_weights(sdf, inv_s, &mut weights);
    // log T_{j+1}
    let mut log_transmittance: Vec<T> = Vec::with_capacity(n);
    for j in 0..n {
        let before = if j == 0 { zero } else { log_transmittance[j - 1] };
        log_transmittance.push(before + log_ratio(sdf[j], sdf[j + 1], inv_s).0);
    }
    let mut after = zero;
    let mut d_inv_s = zero;
    for j in (0..n).rev() {
        if !log_ratio(sdf[j], sdf[j + 1], inv_s).1 {
            let d_delta = after - log_transmittance[j].exp() * d_weights[j] + d_log_transmittance;
            for (i, sign) in [(j + 1, T::of(1.0)), (j, T::of(-1.0))] {
                // 1 − Φ(f) = sigmoid(−inv_s f)
                let slope = sign * d_delta * (-(inv_s * sdf[i])).sigmoid();
                d_sdf[i] += slope * inv_s;
                d_inv_s += slope * sdf[i];
            }
        }
        after += weights[j] * d_weights[j];
    }
    d_inv_s
}

/// Writes Σ_j w_j values\[j\]\[c\] of one ray.
pub fn accumulate<T: Real>(weights: &[T], values: &[T], out: &mut [T]) {
    assert_eq!(values.len(), weights.len() * out.len());
    let k = out.len();
    for (c, out) in out.iter_mut().enumerate() {
        *out = weights.iter().enumerate().map(|(j, &w)| w * values[j * k + c]).sum();
    }
}

/// Adds to the gradients of one ray's weights and values, given that of the sums.
pub fn accumulate_backward<T: Real>(weights: &[T], values: &[T], d_out: &[T], d_weights: &mut [T], d_values: &mut [T]) {
    let k = d_out.len();
    assert!(values.len() == weights.len() * k && values.len() == d_values.len() && weights.len() == d_weights.len());
    for (j, &w) in weights.iter().enumerate() {
        for (c, &d) in d_out.iter().enumerate() {
            d_weights[j] += d * values[j * k + c];
            d_values[j * k + c] += d * w;
        }
    }
}
