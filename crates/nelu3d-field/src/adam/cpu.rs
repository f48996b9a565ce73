//! Fast form: whole cache lines at a time, in loops the compiler vectorizes.

use super::{AdamConfig, Moments, Update};
use crate::prefetch::prefetch;
use pulp::{Arch, Simd, WithSimd};

/// Parameters of a cache line.
const LINE: usize = 16;
/// Lines whose marks are looked at together.
const WORD: usize = 8;
/// Lines between the one worked on and the one asked for.
const AHEAD: usize = 8;

/// Factors of one update in single precision.
#[derive(Clone, Copy)]
struct Factors {
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    rate: f32,
    root: f32,
}

impl Factors {
    fn new(config: &AdamConfig, learning_rate: f64, step: u64) -> Self {
        let u = Update::new(config, learning_rate, step);
        Self {
            beta1: u.beta1 as f32,
            beta2: u.beta2 as f32,
            epsilon: u.epsilon as f32,
            rate: u.rate as f32,
            root: u.root as f32,
        }
    }
}

#[inline(always)]
fn update(k: Factors, p: &mut f32, m: &mut f32, v: &mut f32, g: f32) {
    *m += (1.0 - k.beta1) * (g - *m);
    *v += (1.0 - k.beta2) * (g * g - *v);
    *p -= k.rate * *m / (v.sqrt() * k.root + k.epsilon);
}

struct Dense<'a> {
    k: Factors,
    params: &'a mut [f32],
    moments: Moments<'a>,
    gradient: &'a [f32],
}

impl WithSimd for Dense<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Moments { first, second } = self.moments;
        for (((p, m), v), &g) in self.params.iter_mut().zip(first).zip(second).zip(self.gradient) {
            update(self.k, p, m, v, g);
        }
    }
}

/// Takes one step of every parameter; `step` counts from 0.
pub fn step(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    params: &mut [f32],
    moments: Moments,
    gradient: &[f32],
) {
    assert!(params.len() == moments.len() && params.len() == gradient.len());
    Arch::new().dispatch(Dense { k: Factors::new(config, learning_rate, step), params, moments, gradient });
}

struct Lazy<'a> {
    k: Factors,
    params: &'a mut [f32],
    moments: Moments<'a>,
    gradient: &'a mut [f32],
    touched: &'a mut [u8],
}

impl Lazy<'_> {
    /// Updates one line. Whole lines are updated, by a step of length zero where there is no gradient: memory comes by
    /// lines anyway, a loop without branches is vectorized, and every value is stored (storing some through a mask is
    /// slow).
    #[inline(always)]
    fn line(
        k: Factors,
        params: &mut [f32; LINE],
        first: &mut [f32; LINE],
        second: &mut [f32; LINE],
        gradient: &mut [f32; LINE],
    ) {
        for i in 0..LINE {
            let g = gradient[i];
            let some = if g != 0.0 { 1.0 } else { 0.0 };
            let (m, v) = (first[i], second[i]);
            let m = m + some * (1.0 - k.beta1) * (g - m);
            let v = v + some * (1.0 - k.beta2) * (g * g - v);
            // Not zero, whatever epsilon is: what is multiplied by zero must be a number.
            let size = (v.sqrt() * k.root + k.epsilon).max(f32::MIN_POSITIVE);
            first[i] = m;
            second[i] = v;
            params[i] -= some * k.rate * m / size;
            gradient[i] = 0.0;
        }
    }
}

impl WithSimd for Lazy<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { k, params, moments, gradient, touched } = self;
        let (params, rest_of_params) = params.as_chunks_mut::<LINE>();
        let (first, rest_of_first) = moments.first.as_chunks_mut::<LINE>();
        let (second, rest_of_second) = moments.second.as_chunks_mut::<LINE>();
        let (gradient, rest_of_gradient) = gradient.as_chunks_mut::<LINE>();
        for start in (0..params.len()).step_by(WORD) {
            let marks = touched[start..].first_chunk_mut::<WORD>();
            if marks.as_ref().is_some_and(|marks| **marks == [0; WORD]) {
                continue;
            }
            for l in start..(start + WORD).min(params.len()) {
                if touched.get(l + AHEAD).is_some_and(|&mark| mark != 0) {
                    prefetch(params, l + AHEAD);
                    prefetch(first, l + AHEAD);
                    prefetch(second, l + AHEAD);
                    prefetch(gradient, l + AHEAD);
                }
                if std::mem::take(&mut touched[l]) != 0 {
                    Self::line(k, &mut params[l], &mut first[l], &mut second[l], &mut gradient[l]);
                }
            }
        }
        // At most one line that is not whole.
        if let Some(mark) = touched.get_mut(params.len())
            && std::mem::take(mark) != 0
        {
            let moments = rest_of_first.iter_mut().zip(rest_of_second);
            for ((p, (m, v)), g) in rest_of_params.iter_mut().zip(moments).zip(rest_of_gradient) {
                if *g != 0.0 {
                    update(k, p, m, v, *g);
                }
                *g = 0.0;
            }
        }
    }
}

/// Takes one step of the parameters whose gradient is not exactly zero, among the cache lines (16 values) whose byte in
/// `touched` is set. The gradients used and the marks are cleared on the way, ready for the next step.
pub fn step_lazy(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    params: &mut [f32],
    moments: Moments,
    gradient: &mut [f32],
    touched: &mut [u8],
) {
    let n = params.len();
    assert!(moments.len() == n && gradient.len() == n && touched.len() == n.div_ceil(LINE));
    let k = Factors::new(config, learning_rate, step);
    Arch::new().dispatch(Lazy { k, params, moments, gradient, touched });
}
