//! Fast form: the argument is reduced exactly (doubling and subtracting whole periods are exact in binary), so high
//! octaves lose nothing, and one polynomial serves sine and cosine, in loops over eight points that vectorize.

use super::Frequency;
use pulp::{Arch, Simd, WithSimd};

/// Returns (sin, cos) of π r to about 2e-7, for any |r| < 2^22.
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

/// Points worked on together.
const GROUP: usize = 8;

/// Sines and cosines of one axis, octave after octave.
struct Octaves {
    /// x reduced to a period, times 2^k.
    r: [f32; GROUP],
}

impl Octaves {
    /// Prepares the octaves of the points' coordinates along `axis`; missing points are at the origin.
    #[inline(always)]
    fn new<const D: usize>(points: &[[f32; D]], axis: usize) -> Self {
        let mut r = [0.0; GROUP];
        for (r, x) in r.iter_mut().zip(points) {
            *r = x[axis];
        }
        Self { r }
    }

    /// Returns the next octave's.
    #[inline(always)]
    fn advance(&mut self) -> ([f32; GROUP], [f32; GROUP]) {
        let (mut sin, mut cos) = ([0.0; GROUP], [0.0; GROUP]);
        for p in 0..GROUP {
            let r = self.r[p] - 2.0 * (0.5 * self.r[p]).round_ties_even();
            (sin[p], cos[p]) = sin_cos_pi(r);
            self.r[p] = 2.0 * r;
        }
        (sin, cos)
    }
}

/// Writes the features of many points: `out[point][feature]`. Runs on the calling thread.
pub fn forward<const D: usize>(encoding: Frequency, points: &[[f32; D]], out: &mut [f32]) {
    struct Forward<'a, const D: usize>(Frequency, &'a [[f32; D]], &'a mut [f32]);
    impl<const D: usize> WithSimd for Forward<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(encoding, points, out) = self;
            let n = encoding.n_features(D);
            for (points, out) in points.chunks(GROUP).zip(out.chunks_mut(GROUP * n)) {
                for a in 0..D {
                    let mut octaves = Octaves::new(points, a);
                    for k in 0..encoding.n_frequencies {
                        let (sin, cos) = octaves.advance();
                        let column = 2 * (a * encoding.n_frequencies + k);
                        for (p, row) in out.chunks_exact_mut(n).enumerate() {
                            row[column] = sin[p];
                            row[column + 1] = cos[p];
                        }
                    }
                }
            }
        }
    }
    assert_eq!(out.len(), points.len() * encoding.n_features(D));
    if !out.is_empty() {
        Arch::new().dispatch(Forward(encoding, points, out));
    }
}

/// Writes the gradient of many points, given that of their features, `d_out[point][feature]`. Runs on the calling
/// thread.
pub fn backward<const D: usize>(encoding: Frequency, points: &[[f32; D]], d_out: &[f32], d_points: &mut [[f32; D]]) {
    struct Backward<'a, const D: usize>(Frequency, &'a [[f32; D]], &'a [f32], &'a mut [[f32; D]]);
    impl<const D: usize> WithSimd for Backward<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(encoding, points, d_out, d_points) = self;
            let n = encoding.n_features(D);
            if n == 0 {
                return d_points.fill([0.0; D]);
            }
            let blocks = points.chunks(GROUP).zip(d_points.chunks_mut(GROUP));
            for ((points, d_points), d_out) in blocks.zip(d_out.chunks(GROUP * n)) {
                for a in 0..D {
                    let mut octaves = Octaves::new(points, a);
                    let mut omega = std::f32::consts::PI;
                    let mut sum = [0.0; GROUP];
                    for k in 0..encoding.n_frequencies {
                        let (sin, cos) = octaves.advance();
                        let column = 2 * (a * encoding.n_frequencies + k);
                        for (p, row) in d_out.chunks_exact(n).enumerate() {
                            sum[p] += omega * (row[column] * cos[p] - row[column + 1] * sin[p]);
                        }
                        omega *= 2.0;
                    }
                    for (d, sum) in d_points.iter_mut().zip(sum) {
                        d[a] = sum;
                    }
                }
            }
        }
    }
    assert_eq!(d_out.len(), points.len() * encoding.n_features(D));
    assert_eq!(d_points.len(), points.len());
    Arch::new().dispatch(Backward(encoding, points, d_out, d_points));
}
