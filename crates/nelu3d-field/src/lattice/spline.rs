//! Uniform cubic B-splines (de Boor 1978, *A Practical Guide to Splines*): the weights of the four nodes around a
//! point.

use crate::Real;

/// Returns the four weights at the position `f` in a cell, in `[0, 1]`, times six.
#[inline(always)]
pub fn weights_times_six<T: Real>(f: T) -> [T; 4] {
    let n = T::of;
    let g = n(1.0) - f;
    let (f2, g2) = (f * f, g * g);
    [g2 * g, n(4.0) - f2 * (n(6.0) - n(3.0) * f), n(4.0) - g2 * (n(6.0) - n(3.0) * g), f2 * f]
}

/// Returns the four weights at the position `f` in a cell, in `[0, 1]`. Their sum is 1.
#[inline(always)]
pub fn weights<T: Real>(f: T) -> [T; 4] {
    weights_times_six(f).map(|w| w / T::of(6.0))
}

/// Returns [`weights`] as products with 1/6 instead of quotients, which is faster and differs in the last bit: for
/// fits, which evaluate every sample in every iteration.
#[inline(always)]
pub fn weights_by_product(f: f32) -> [f32; 4] {
    const SIXTH: f32 = 1.0 / 6.0;
    weights_times_six(f).map(|w| w * SIXTH)
}

/// Returns the derivatives of the four weights by the position `f` in a cell. Their sum is 0.
#[inline(always)]
pub fn slopes(f: f32) -> [f32; 4] {
    let g = 1.0 - f;
    [-0.5 * g * g, 0.5 * f * (3.0 * f - 4.0), -0.5 * g * (3.0 * g - 4.0), 0.5 * f * f]
}
