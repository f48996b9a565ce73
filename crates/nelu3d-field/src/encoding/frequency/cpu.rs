//! Fast form: the argument is reduced exactly (doubling and subtracting whole periods are exact in binary), so high
//! octaves lose nothing, and one polynomial serves sine and cosine in a loop that vectorizes.

use super::Frequency;
use pulp::{Arch, Simd, WithSimd};

/// (sin, cos) of π r to about 2e-7, for any |r| < 2^22.
#[inline(always)]
fn sin_cos_pi(r: f32) -> (f32, f32) {
    // r = quarters / 2 + rest, |rest| <= 1/4; adding 1.5 · 2^23 rounds to an integer held in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let shifted = 2.0 * r + ROUND;
    let quarters = shifted.to_bits();
    let t = (r - 0.5 * (shifted - ROUND)) * std::f32::consts::PI;
    // Taylor series on |t| <= π/4: the first terms left out are t^11/11! and t^10/10!, below 2e-9 and 3e-8.
    let t2 = t * t;
    let sin = t + t * t2 * (-1.0 / 6.0 + t2 * (1.0 / 120.0 + t2 * (-1.0 / 5040.0 + t2 * (1.0 / 362_880.0))));
    let cos = 1.0 + t2 * (-0.5 + t2 * (1.0 / 24.0 + t2 * (-1.0 / 720.0 + t2 * (1.0 / 40320.0))));
    let (s, c) = if quarters & 1 == 1 { (cos, sin) } else { (sin, cos) };
    let s = f32::from_bits(s.to_bits() ^ (quarters & 2) << 30);
    let c = f32::from_bits(c.to_bits() ^ (quarters.wrapping_add(1) & 2) << 30);
    (s, c)
}

/// Calls `visit(feature index of the sine, axis, sin, cos)` for one point.
#[inline(always)]
fn each<const D: usize>(encoding: Frequency, x: [f32; D], mut visit: impl FnMut(usize, usize, f32, f32)) {
    for (a, &x) in x.iter().enumerate() {
        let mut r = x;
        for k in 0..encoding.n_frequencies {
            r -= 2.0 * (0.5 * r).round_ties_even();
            let (sin, cos) = sin_cos_pi(r);
            visit(2 * (a * encoding.n_frequencies + k), a, sin, cos);
            r *= 2.0;
        }
    }
}

/// Features of many points: `out[point][feature]`. Runs on the calling thread.
pub fn forward<const D: usize>(encoding: Frequency, points: &[[f32; D]], out: &mut [f32]) {
    struct Forward<'a, const D: usize>(Frequency, &'a [[f32; D]], &'a mut [f32]);
    impl<const D: usize> WithSimd for Forward<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(encoding, points, out) = self;
            for (&x, out) in points.iter().zip(out.chunks_exact_mut(encoding.n_features(D))) {
                each(encoding, x, |i, _, sin, cos| {
                    out[i] = sin;
                    out[i + 1] = cos;
                });
            }
        }
    }
    assert_eq!(out.len(), points.len() * encoding.n_features(D));
    if !out.is_empty() {
        Arch::new().dispatch(Forward(encoding, points, out));
    }
}

/// Gradient of many points, given that of their features, `d_out[point][feature]`. Runs on the calling thread.
pub fn backward<const D: usize>(encoding: Frequency, points: &[[f32; D]], d_out: &[f32], d_points: &mut [[f32; D]]) {
    struct Backward<'a, const D: usize>(Frequency, &'a [[f32; D]], &'a [f32], &'a mut [[f32; D]]);
    impl<const D: usize> WithSimd for Backward<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(encoding, points, d_out, d_points) = self;
            let n = encoding.n_features(D);
            for (p, (&x, d_x)) in points.iter().zip(d_points).enumerate() {
                let d_out = &d_out[p * n..][..n];
                let mut sum = [0.0; D];
                let mut omega = [std::f32::consts::PI; D];
                each(encoding, x, |i, a, sin, cos| {
                    sum[a] += omega[a] * (d_out[i] * cos - d_out[i + 1] * sin);
                    omega[a] *= 2.0;
                });
                *d_x = sum;
            }
        }
    }
    assert_eq!(d_out.len(), points.len() * encoding.n_features(D));
    assert_eq!(d_points.len(), points.len());
    Arch::new().dispatch(Backward(encoding, points, d_out, d_points));
}
