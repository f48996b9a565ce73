//! Fast form: parallel over fixed parts, sums in double precision. Same arguments as [`super::reference`].

use super::{MASK_CLAMP, MIN_OPACITY, Norms};
use crate::reduce::fill_and_sum;

#[inline(always)]
fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { 1f32.copysign(x) }
}

/// Returns the mean of `f(i).0` with `d[i]` = `f(i).1` / n.
fn mean(n: usize, d: &mut [f32], f: impl Fn(usize) -> (f32, f32) + Sync) -> f64 {
    assert_eq!(d.len(), n);
    let scale = 1.0 / n.max(1) as f64;
    let sum = fill_and_sum(d, &|offset, d| {
        let mut sum = 0.0;
        for (i, d) in d.iter_mut().enumerate() {
            let (value, slope) = f(offset + i);
            sum += value as f64;
            *d = slope * scale as f32;
        }
        sum
    });
    sum * scale
}

/// Returns l1 |r| + l2 r² and its derivative.
#[inline(always)]
pub(crate) fn robust_at(norms: Norms, r: f32) -> (f32, f32) {
    let (l1, l2) = (norms.l1 as f32, norms.l2 as f32);
    (l1 * r.abs() + l2 * r * r, l1 * sign(r) + 2.0 * l2 * r)
}

/// Returns the binary cross-entropy of a clamped opacity and its derivative, 0 where the clamp acts.
#[inline(always)]
pub(crate) fn mask_at(opacity: f32, mask: f32) -> (f32, f32) {
    let (low, high) = (MASK_CLAMP as f32, 1.0 - MASK_CLAMP as f32);
    let o = opacity.max(low).min(high);
    let slope = if (low..=high).contains(&opacity) { (o - mask) / (o * (1.0 - o)) } else { 0.0 };
    (-(mask * o.ln() + (1.0 - mask) * (1.0 - o).ln()), slope)
}

/// Returns the same by log T, unclamped towards O = 1, and its derivative.
#[inline(always)]
pub(crate) fn mask_log_at(log_transmittance: f64, mask: f64) -> (f64, f64) {
    let o = -log_transmittance.exp_m1();
    let slope = if o > MIN_OPACITY { mask * log_transmittance.exp() / o } else { 0.0 };
    (-(mask * o.max(MIN_OPACITY).ln() + (1.0 - mask) * log_transmittance), slope - (1.0 - mask))
}

/// Returns (|g| − 1)² and its gradient, 0 at g = 0.
#[inline(always)]
pub(crate) fn eikonal_at(g: [f32; 3]) -> (f32, [f32; 3]) {
    let norm = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]).sqrt();
    let excess = norm - 1.0;
    let factor = if norm > 0.0 { 2.0 * excess / norm } else { 0.0 };
    (excess * excess, g.map(|x| factor * x))
}

/// Returns exp(−|f|) and its derivative.
#[inline(always)]
pub(crate) fn sparsity_at(f: f32) -> (f32, f32) {
    let e = (-f.abs()).exp();
    (e, -sign(f) * e)
}

/// Computes Eq. 3: l1 |r| + l2 r².
pub fn lookup(norms: Norms, residuals: &[f32], d: &mut [f32]) -> f64 {
    mean(residuals.len(), d, |i| robust_at(norms, residuals[i]))
}

/// Computes Eq. 2: l1 |I_white r| + l2 (I_white r)².
pub fn pattern(norms: Norms, residuals: &[f32], white: &[f32], d: &mut [f32]) -> f64 {
    assert_eq!(residuals.len(), white.len());
    mean(residuals.len(), d, |i| {
        let (value, slope) = robust_at(norms, white[i] * residuals[i]);
        (value, white[i] * slope)
    })
}

/// Computes Eq. 5: binary cross-entropy of the opacity, clamped to [1e-3, 1 − 1e-3]; no gradient where the clamp acts.
pub fn mask(opacity: &[f32], mask: &[f32], d: &mut [f32]) -> f64 {
    assert_eq!(opacity.len(), mask.len());
    mean(opacity.len(), d, |i| mask_at(opacity[i], mask[i]))
}

/// Computes Eq. 5 for opacities given as O = 1 − T by log T, unclamped towards 1.
pub fn mask_log(log_transmittance: &[f32], mask: &[f32], d: &mut [f32]) -> f64 {
    assert_eq!(log_transmittance.len(), mask.len());
    mean(mask.len(), d, |i| {
        let (value, slope) = mask_log_at(log_transmittance[i] as f64, mask[i] as f64);
        (value as f32, slope as f32)
    })
}

/// Computes Eq. 6: (|∇f| − 1)². At ∇f = 0 the gradient is 0.
pub fn eikonal(gradients: &[[f32; 3]], d: &mut [[f32; 3]]) -> f64 {
    assert_eq!(gradients.len(), d.len());
    let scale = 1.0 / gradients.len().max(1) as f64;
    let sum = fill_and_sum(d, &|offset, d| {
        let mut sum = 0.0;
        for (d, &g) in d.iter_mut().zip(&gradients[offset..]) {
            let (value, slope) = eikonal_at(g);
            sum += value as f64;
            *d = slope.map(|x| x * scale as f32);
        }
        sum
    });
    sum * scale
}

/// Computes Eq. 6: exp(−|f|).
pub fn sparsity(sdf: &[f32], d: &mut [f32]) -> f64 {
    mean(sdf.len(), d, |i| sparsity_at(sdf[i]))
}
