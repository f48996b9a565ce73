//! The plain form: sample by sample, node by node.

use super::{NodeStrides, Place, Weights};
use crate::lattice::{slopes, weights};

/// Calls `f(first value of the node, its weight)` for the 64 nodes of a sample.
fn for_each_node(strides: NodeStrides, place: &Place, mut f: impl FnMut(usize, f64)) {
    let spread = [place.spread[0], place.spread[1], 0.0];
    let along: [[f64; 4]; 3] = std::array::from_fn(|axis| {
        // w″ is the difference of slopes, which are quadratic.
        let x = place.position[axis];
        let (here, before, after) = (weights(f64::from(x)), slopes(x - 0.5), slopes(x + 0.5));
        std::array::from_fn(|n| here[n] + 0.5 * f64::from(spread[axis]) * f64::from(after[n] - before[n]))
    });
    for n in 0..64 {
        let [a, b, w] = [n / 4 % 4, n / 16, n % 4];
        let at = place.base as usize + b * strides.row + a * strides.column + w * strides.k;
        f(at, along[0][a] * along[1][b] * along[2][w]);
    }
}

/// Adds Bᵀ Ω B x to y.
pub fn add_product(strides: NodeStrides, places: &[Place], omegas: &[f32], x: &[f32], y: &mut [f64]) {
    for (place, omegas) in places.iter().zip(omegas.chunks_exact(strides.k)) {
        let mut values = vec![0.0; strides.k];
        for_each_node(strides, place, |at, weight| {
            values.iter_mut().zip(&x[at..]).for_each(|(v, x)| *v += weight * f64::from(*x));
        });
        values.iter_mut().zip(omegas).for_each(|(v, omega)| *v *= f64::from(*omega));
        for_each_node(strides, place, |at, weight| {
            y[at..].iter_mut().zip(&values).for_each(|(y, v)| *y += weight * v);
        });
    }
}

/// Adds the samples' values to their nodes.
pub fn add_spread(strides: NodeStrides, places: &[Place], values: &[f32], by: Weights, y: &mut [f64]) {
    for (place, values) in places.iter().zip(values.chunks_exact(strides.k)) {
        for_each_node(strides, place, |at, weight| {
            let weight = if by == Weights::Squared { weight * weight } else { weight };
            y[at..].iter_mut().zip(values).for_each(|(y, v)| *y += weight * f64::from(*v));
        });
    }
}
