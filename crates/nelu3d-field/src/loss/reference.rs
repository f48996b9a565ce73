//! Plain form: each function returns the loss and writes its gradient.

use super::{MASK_CLAMP, MIN_OPACITY, Norms};
use crate::Real;

fn sign<T: Real>(x: T) -> T {
    T::of(if x > T::of(0.0) {
        1.0
    } else if x < T::of(0.0) {
        -1.0
    } else {
        0.0
    })
}

/// Returns the mean over the elements of `x`: `f(i)` returns (value, derivative).
fn mean<T: Real>(n: usize, d: &mut [T], mut f: impl FnMut(usize) -> (T, T)) -> T {
    assert_eq!(d.len(), n);
    let scale = T::of(1.0 / n.max(1) as f64);
    let mut sum = T::of(0.0);
    for (i, d) in d.iter_mut().enumerate() {
        let (value, slope) = f(i);
        sum += value;
        *d = slope * scale;
    }
    sum * scale
}

/// Computes Eq. 3: l1 |r| + l2 r².
pub fn lookup<T: Real>(norms: Norms, residuals: &[T], d: &mut [T]) -> T {
    let (l1, l2) = (T::of(norms.l1), T::of(norms.l2));
    mean(residuals.len(), d, |i| {
        let r = residuals[i];
        (l1 * r.abs() + l2 * r * r, l1 * sign(r) + T::of(2.0) * l2 * r)
    })
}

/// Computes Eq. 2: l1 |I_white r| + l2 (I_white r)².
pub fn pattern<T: Real>(norms: Norms, residuals: &[T], white: &[T], d: &mut [T]) -> T {
    assert_eq!(residuals.len(), white.len());
    let (l1, l2) = (T::of(norms.l1), T::of(norms.l2));
    mean(residuals.len(), d, |i| {
        let r = white[i] * residuals[i];
        (l1 * r.abs() + l2 * r * r, white[i] * (l1 * sign(r) + T::of(2.0) * l2 * r))
    })
}

/// Computes Eq. 5: binary cross-entropy of the opacity, clamped to [1e-3, 1 − 1e-3]; no gradient where the clamp acts.
pub fn mask<T: Real>(opacity: &[T], mask: &[T], d: &mut [T]) -> T {
    assert_eq!(opacity.len(), mask.len());
    let one = T::of(1.0);
    let (low, high) = (T::of(MASK_CLAMP), T::of(1.0 - MASK_CLAMP));
    mean(opacity.len(), d, |i| {
        let m = mask[i];
        let o = opacity[i].max(low).min(high);
        let inside = opacity[i] >= low && opacity[i] <= high;
        let slope = if inside { (o - m) / (o * (one - o)) } else { T::of(0.0) };
        (-(m * o.ln() + (one - m) * (one - o).ln()), slope)
    })
}

/// Computes Eq. 5 for opacities given as O = 1 − T by log T, unclamped towards 1: it never saturates where a ray is
/// blocked. O is kept above [`MIN_OPACITY`]; no gradient below.
pub fn mask_log<T: Real>(log_transmittance: &[T], mask: &[T], d: &mut [T]) -> T {
    assert_eq!(log_transmittance.len(), mask.len());
    let one = T::of(1.0);
    mean(mask.len(), d, |i| {
        let (x, m) = (log_transmittance[i], mask[i]);
        let o = -x.exp_m1();
        let least = T::of(MIN_OPACITY);
        let slope = if o > least { m * x.exp() / o } else { T::of(0.0) };
        (-(m * o.max(least).ln() + (one - m) * x), slope - (one - m))
    })
}

/// Computes Eq. 6: (|∇f| − 1)². At ∇f = 0 the gradient is 0.
pub fn eikonal<T: Real>(gradients: &[[T; 3]], d: &mut [[T; 3]]) -> T {
    assert_eq!(gradients.len(), d.len());
    let scale = T::of(1.0 / gradients.len().max(1) as f64);
    let mut sum = T::of(0.0);
    for (g, d) in gradients.iter().zip(d) {
        let norm = g.iter().map(|&x| x * x).sum::<T>().sqrt();
        let excess = norm - T::of(1.0);
        sum += excess * excess;
        let factor = if norm > T::of(0.0) { T::of(2.0) * excess / norm * scale } else { T::of(0.0) };
        *d = g.map(|x| factor * x);
    }
    sum * scale
}

/// Computes Eq. 6: exp(−|f|).
pub fn sparsity<T: Real>(sdf: &[T], d: &mut [T]) -> T {
    mean(sdf.len(), d, |i| {
        let e = (-sdf[i].abs()).exp();
        (e, -sign(sdf[i]) * e)
    })
}
