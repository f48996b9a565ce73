//! Fast form of a network with one linear output whose input gradient is part of the loss.
//!
//! With one output y and ReLU, everything the two backward passes need is there after one: let h_l be the inputs of
//! layer l (h_0 the network's) and d_l = ∂y/∂(sums of layer l). A loss with s = ∂L/∂y and v = ∂L/∂(∂y/∂h_0) has
//!
//! ```text
//! ∂L/∂W_l = d_l (s h_l + t_l)ᵀ,   ∂L/∂b_l = s d_l,   t_0 = v,   t_l = 1(h_l > 0) ∘ W_{l−1} t_{l−1}
//! ```
//!
//! The d_l are those that the gradient itself took, before s and v were known. So the second derivative costs the pass
//! that carries t forward, and nothing else: no second backward pass, no products of its own for the weights.

use super::cpu::{Layer, MlpGradient, PackedMlp, padded, rows};
use super::gemm;
use pulp::Simd;

/// What the two passes over a block share.
#[derive(Clone, Debug, Default)]
pub(crate) struct GradientScratch {
    /// Outputs of every hidden layer, `[row][padded width]`; [`accumulate`] turns them into s h + t.
    hidden: Vec<Vec<f32>>,
    /// Gradient of y by the sums of every hidden layer, same shapes.
    d_hidden: Vec<Vec<f32>>,
    /// The rows with t of two neighboring layers.
    tangents: [Vec<f32>; 2],
}

impl GradientScratch {
    /// Grows to blocks of `n` points.
    pub(crate) fn reserve(&mut self, mlp: &PackedMlp, n: usize) {
        let n_hidden = mlp.layers.len() - 1;
        let width = padded(mlp.layers[0].n_out);
        let stride = width.max(padded(mlp.layers[0].n_in));
        self.hidden.resize_with(n_hidden, Vec::new);
        self.d_hidden.resize_with(n_hidden, Vec::new);
        for values in self.hidden.iter_mut().chain(&mut self.d_hidden) {
            if values.len() < rows(n) * width {
                values.resize(rows(n) * width, 0.0);
            }
        }
        for values in &mut self.tangents {
            if values.len() < rows(n) * stride {
                values.resize(rows(n) * stride, 0.0);
            }
        }
    }
}

/// Computes the outputs `y` of `n` points and their gradients by the inputs, `d_x[row][padded n_inputs]`; `x` likewise,
/// with `rows(n)` rows of finite values.
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    mlp: &PackedMlp,
    x: &[f32],
    n: usize,
    scratch: &mut GradientScratch,
    y: &mut [f32],
    d_x: &mut [f32],
) {
    let rows = rows(n);
    let (output, hidden_layers) = mlp.layers.split_last().expect("a network has layers");
    assert_eq!(output.n_out, 1);
    let last = hidden_layers.len() - 1;
    for (l, layer) in hidden_layers.iter().enumerate() {
        let (n_in, n_out) = (padded(layer.n_in), padded(layer.n_out));
        let (before, after) = scratch.hidden.split_at_mut(l);
        let input = if l == 0 { x } else { &before[l - 1][..] };
        let (input, hidden) = (&input[..rows * n_in], &mut after[0][..rows * n_out]);
        let biases = Some(&layer.biases[..]);
        gemm::multiply(simd, input, n_in, layer.n_in, &layer.transposed, n_out, biases, true, hidden);
    }
    // The output layer has one row of weights: its gradient is that row where the unit is active.
    let width = padded(output.n_in);
    let weights = &output.weights[..width];
    let hidden = &scratch.hidden[last][..rows * width];
    let d_hidden = &mut scratch.d_hidden[last][..rows * width];
    for (p, (h, d)) in hidden.chunks_exact(width).zip(d_hidden.chunks_exact_mut(width)).enumerate() {
        let mut sums = [0.0f32; gemm::LANES];
        let (h, d) = (h.as_chunks::<{ gemm::LANES }>().0, d.as_chunks_mut::<{ gemm::LANES }>().0);
        for ((h, d), w) in h.iter().zip(d).zip(weights.as_chunks::<{ gemm::LANES }>().0) {
            for i in 0..gemm::LANES {
                sums[i] += h[i] * w[i];
                d[i] = if h[i] > 0.0 { w[i] } else { 0.0 };
            }
        }
        if let Some(y) = y.get_mut(p) {
            *y = output.biases[0] + sums.iter().sum::<f32>();
        }
    }
    for (l, layer) in hidden_layers.iter().enumerate().rev() {
        let (n_in, n_out) = (padded(layer.n_in), padded(layer.n_out));
        let (before, after) = scratch.d_hidden.split_at_mut(l);
        let d_sums = &after[0][..rows * n_out];
        let d_input = if l == 0 { &mut d_x[..rows * n_in] } else { &mut before[l - 1][..rows * n_in] };
        gemm::multiply(simd, d_sums, n_out, layer.n_out, &layer.weights, n_in, None, false, d_input);
        if l > 0 {
            gate(d_input, &scratch.hidden[l - 1][..rows * n_in]);
        }
    }
}

/// Sets d = 0 where a unit is not active.
#[inline(always)]
fn gate(d: &mut [f32], hidden: &[f32]) {
    for (d, &h) in d.iter_mut().zip(hidden) {
        *d = if h > 0.0 { *d } else { 0.0 };
    }
}

/// Adds the gradient of the parameters after [`forward`] of the same block, given s per point and v of every `every`-th
/// point, `[point / every][padded n_inputs]` with whole rows of padding (`every` = 0: of none). `x` is overwritten.
#[inline(always)]
pub(crate) fn accumulate<S: Simd>(
    simd: S,
    mlp: &PackedMlp,
    x: &mut [f32],
    s: &[f32],
    every: usize,
    v: &[f32],
    scratch: &mut GradientScratch,
    gradient: &mut MlpGradient,
) {
    let n = s.len();
    let n_rows = rows(n);
    let n_tangents = if every == 0 { 0 } else { n.div_ceil(every) };
    let tangent_rows = rows(n_tangents);
    let GradientScratch { hidden, d_hidden, tangents: [now, next] } = scratch;
    let (output, hidden_layers) = mlp.layers.split_last().expect("a network has layers");
    let n_inputs = padded(hidden_layers[0].n_in);
    now[..tangent_rows * n_inputs].copy_from_slice(&v[..tangent_rows * n_inputs]);
    for (l, layer) in hidden_layers.iter().enumerate() {
        let Layer { n_in, n_out, .. } = *layer;
        let (stride, width) = (padded(n_in), padded(n_out));
        if tangent_rows > 0 {
            let next = &mut next[..tangent_rows * width];
            gemm::multiply(
                simd,
                &now[..tangent_rows * stride],
                stride,
                n_in,
                &layer.transposed,
                width,
                None,
                false,
                next,
            );
            for (t, next) in next.chunks_exact_mut(width).enumerate().take(n_tangents) {
                gate(next, &hidden[l][t * every * width..][..width]);
            }
        }
        let input = if l == 0 { &mut x[..n_rows * stride] } else { &mut hidden[l - 1][..n_rows * stride] };
        combine(input, stride, s, every, now);
        let d_sums = &d_hidden[l][..n_rows * width];
        gemm::accumulate_outer(simd, d_sums, width, n_out, input, stride, &mut gradient.weights[l]);
        let biases = &mut gradient.biases[l][..width];
        for (row, &s) in d_sums.chunks_exact(width).zip(s) {
            biases.iter_mut().zip(row).for_each(|(b, d)| *b += s * d);
        }
        std::mem::swap(now, next);
    }
    let last = hidden_layers.len();
    let width = padded(output.n_in);
    let input = &mut hidden[last - 1][..n_rows * width];
    combine(input, width, s, every, now);
    for row in input.chunks_exact(width) {
        gradient.weights[last].iter_mut().zip(row).for_each(|(w, x)| *w += x);
    }
    gradient.biases[last][0] += s.iter().sum::<f32>();
}

/// Computes h ← s h + t, row by row; rows after the last point become zero.
#[inline(always)]
fn combine(h: &mut [f32], stride: usize, s: &[f32], every: usize, tangents: &[f32]) {
    for (p, row) in h.chunks_exact_mut(stride).enumerate() {
        let Some(&s) = s.get(p) else {
            row.fill(0.0);
            continue;
        };
        if every > 0 && p.is_multiple_of(every) {
            let t = &tangents[p / every * stride..][..stride];
            row.iter_mut().zip(t).for_each(|(h, t)| *h = s * *h + t);
        } else {
            row.iter_mut().for_each(|h| *h *= s);
        }
    }
}
