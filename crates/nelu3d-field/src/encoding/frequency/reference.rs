//! Plain form, one point at a time.

use super::Frequency;
use crate::Real;

/// Writes the features of one point.
pub fn forward<T: Real, const D: usize>(encoding: Frequency, x: [T; D], out: &mut [T]) {
    assert_eq!(out.len(), encoding.n_features(D));
    for (a, out) in out.chunks_exact_mut(2 * encoding.n_frequencies).enumerate() {
        for (k, out) in out.chunks_exact_mut(2).enumerate() {
            let (sin, cos) = (T::of((k as f64).exp2() * std::f64::consts::PI) * x[a]).sin_cos();
            out.copy_from_slice(&[sin, cos]);
        }
    }
}

/// Writes the gradient of one point, given that of its features.
pub fn backward<T: Real, const D: usize>(encoding: Frequency, x: [T; D], d_out: &[T]) -> [T; D] {
    assert_eq!(d_out.len(), encoding.n_features(D));
    let mut d_x = [T::of(0.0); D];
    for (a, d_out) in d_out.chunks_exact(2 * encoding.n_frequencies).enumerate() {
        for (k, d) in d_out.chunks_exact(2).enumerate() {
            let omega = T::of((k as f64).exp2() * std::f64::consts::PI);
            let (sin, cos) = (omega * x[a]).sin_cos();
            d_x[a] += omega * (d[0] * cos - d[1] * sin);
        }
    }
    d_x
}
