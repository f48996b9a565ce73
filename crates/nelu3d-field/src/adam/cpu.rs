//! Fast form: touched entries are gathered into short runs that the compiler vectorizes.

use super::{AdamConfig, Moments, Update};
use crate::prefetch::prefetch;
use pulp::{Arch, Simd, WithSimd};

/// Parameters updated together.
const RUN: usize = 64;
/// Words of the bit mask between the entries worked on and those asked for.
const AHEAD: usize = 2;
/// Bytes of a cache line.
const LINE: usize = 64;

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
    moments: &'a mut [Moments],
    gradient: &'a [f32],
}

impl WithSimd for Dense<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for ((p, [m, v]), &g) in self.params.iter_mut().zip(self.moments).zip(self.gradient) {
            update(self.k, p, m, v, g);
        }
    }
}

/// One step of every parameter; `step` counts from 0. `moments[i]` is `[m, v]` of `params[i]`.
pub fn step(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    params: &mut [f32],
    moments: &mut [Moments],
    gradient: &[f32],
) {
    assert!(params.len() == moments.len() && params.len() == gradient.len());
    Arch::new().dispatch(Dense { k: Factors::new(config, learning_rate, step), params, moments, gradient });
}

/// One step of the entries of `F` parameters whose bit in `touched` is set; clears their gradients and the bits.
#[inline(always)]
fn step_lazy_features<const F: usize>(
    k: Factors,
    params: &mut [f32],
    moments: &mut [Moments],
    gradient: &mut [f32],
    touched: &mut [u64],
) {
    let (params, _) = params.as_chunks_mut::<F>();
    let (moments, _) = moments.as_chunks_mut::<F>();
    let (gradient, _) = gradient.as_chunks_mut::<F>();
    let mut entries = [0u32; RUN];
    let (mut p, mut m, mut v, mut g) = ([0f32; RUN], [0f32; RUN], [0f32; RUN], [0f32; RUN]);
    let mut n = 0;
    let last = touched.len().wrapping_sub(1);
    for word in 0..touched.len() {
        let mut bits = std::mem::take(&mut touched[word]);
        if touched.get(word + AHEAD).is_some_and(|&bits| bits != 0) {
            let start = (word + AHEAD) * 64;
            for e in (start..start + 64).step_by((LINE / (4 * F)).max(1)) {
                prefetch(params, e);
                prefetch(gradient, e);
            }
            for e in (start..start + 64).step_by((LINE / (8 * F)).max(1)) {
                prefetch(moments, e);
            }
        }
        loop {
            if bits != 0 {
                let e = word * 64 + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                entries[n / F] = e as u32;
                let gradient = std::mem::replace(&mut gradient[e], [0.0; F]);
                for f in 0..F {
                    p[n + f] = params[e][f];
                    [m[n + f], v[n + f]] = moments[e][f];
                    g[n + f] = gradient[f];
                }
                n += F;
            }
            let done = bits == 0;
            if n == RUN || (done && word == last) {
                for i in 0..RUN {
                    update(k, &mut p[i], &mut m[i], &mut v[i], g[i]);
                }
                for (r, &e) in entries[..n / F].iter().enumerate() {
                    for f in 0..F {
                        params[e as usize][f] = p[r * F + f];
                        moments[e as usize][f] = [m[r * F + f], v[r * F + f]];
                    }
                }
                n = 0;
            }
            if done {
                break;
            }
        }
    }
}

struct Lazy<'a> {
    k: Factors,
    n_features: usize,
    params: &'a mut [f32],
    moments: &'a mut [Moments],
    gradient: &'a mut [f32],
    touched: &'a mut [u64],
}

impl WithSimd for Lazy<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { k, n_features, params, moments, gradient, touched } = self;
        match n_features {
            1 => step_lazy_features::<1>(k, params, moments, gradient, touched),
            2 => step_lazy_features::<2>(k, params, moments, gradient, touched),
            4 => step_lazy_features::<4>(k, params, moments, gradient, touched),
            8 => step_lazy_features::<8>(k, params, moments, gradient, touched),
            _ => panic!("no kernel for {n_features} features"),
        }
    }
}

/// One step of the entries whose bit is set: bit `e % 64` of `touched[e / 64]` stands for the parameters
/// `e · n_features ..` of entry e. The gradients used and the bits are cleared on the way, ready for the next step.
///
/// # Panics
/// If `n_features` is not 1, 2, 4 or 8.
#[expect(clippy::too_many_arguments)]
pub fn step_lazy(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    n_features: usize,
    params: &mut [f32],
    moments: &mut [Moments],
    gradient: &mut [f32],
    touched: &mut [u64],
) {
    let n = params.len();
    assert!(moments.len() == n && gradient.len() == n && touched.len() == n.div_ceil(64 * n_features));
    let k = Factors::new(config, learning_rate, step);
    Arch::new().dispatch(Lazy { k, n_features, params, moments, gradient, touched });
}
