//! Weight normalization (Salimans & Kingma 2016, Eq. 2, 3): a unit's weights are w = g v / |v|, and g and v are
//! learned.
//!
//! It is a change of variables between optimizer and network, so the network's kernels do not know of it. The raw
//! parameters are those of the network with v in the place of w, then g of every unit, layer by layer.

use super::MlpConfig;
use crate::Real;

/// Returns the number of raw parameters.
pub fn n_raw(config: &MlpConfig) -> usize {
    config.n_params() + config.layers().map(|(_, n_out)| n_out).sum::<usize>()
}

/// Returns the raw parameters of given weights: v = w, g = |w|.
pub fn from_weights<T: Real>(config: &MlpConfig, params: &[T]) -> Vec<T> {
    let mut raw = params.to_vec();
    for_each_unit(config, |weights, _| raw.push(norm(&params[weights])));
    raw
}

/// Writes the weights of raw parameters.
pub fn to_weights<T: Real>(config: &MlpConfig, raw: &[T], params: &mut [T]) {
    let (v, g) = raw.split_at(config.n_params());
    params.copy_from_slice(v);
    for_each_unit(config, |weights, unit| {
        let scale = g[unit] / norm(&v[weights.clone()]);
        params[weights].iter_mut().for_each(|w| *w *= scale);
    });
}

/// Writes the gradient by the raw parameters, given that by the weights (Eq. 3).
pub fn backward<T: Real>(config: &MlpConfig, raw: &[T], d_params: &[T], d_raw: &mut [T]) {
    let (v, g) = raw.split_at(config.n_params());
    let (d_v, d_g) = d_raw.split_at_mut(config.n_params());
    d_v.copy_from_slice(d_params);
    for_each_unit(config, |weights, unit| {
        let v = &v[weights.clone()];
        let length = norm(v);
        let along = v.iter().zip(&d_params[weights.clone()]).map(|(&v, &d)| v * d).sum::<T>() / length;
        d_g[unit] = along;
        let scale = g[unit] / length;
        for (d, &v) in d_v[weights].iter_mut().zip(v) {
            *d = scale * (*d - along * v / length);
        }
    });
}

/// Returns the norm of v. A unit whose weights are all zero has no direction; it keeps none.
fn norm<T: Real>(v: &[T]) -> T {
    let square = v.iter().map(|&x| x * x).sum::<T>();
    let tiny = T::of(1e-30);
    if square > tiny { square.sqrt() } else { tiny.sqrt() }
}

/// Calls `f` with the place of every unit's weights, and the unit's number.
fn for_each_unit(config: &MlpConfig, mut f: impl FnMut(std::ops::Range<usize>, usize)) {
    let (mut at, mut unit) = (0, 0);
    for (n_in, n_out) in config.layers() {
        for _ in 0..n_out {
            f(at..at + n_in, unit);
            at += n_in;
            unit += 1;
        }
        at += n_out;
    }
}
