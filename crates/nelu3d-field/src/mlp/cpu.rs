//! Fast form: blocks of [`BLOCK`] points, rows padded to whole vectors, register-tiled products.

use super::gemm::{self, LANES, ROWS};
use super::{Activation, MlpConfig};
use pulp::{Arch, Simd, WithSimd};

/// Points of a block: two activations and one weight matrix of width 64 then stay in the first two cache levels.
pub const BLOCK: usize = 96;

/// Returns `n` rounded up to whole vectors: the row length of every matrix here.
pub(crate) fn padded(n: usize) -> usize {
    n.next_multiple_of(LANES)
}

/// One layer, zero-padded, in the two layouts its two products want.
#[derive(Clone, Debug)]
pub(super) struct Layer {
    pub(super) n_in: usize,
    pub(super) n_out: usize,
    /// `[n_out][padded n_in]`, for the gradient of the input.
    pub(super) weights: Vec<f32>,
    /// `[n_in][padded n_out]`, for the forward pass.
    pub(super) transposed: Vec<f32>,
    /// `[padded n_out]`
    pub(super) biases: Vec<f32>,
}

/// A network's parameters laid out for the kernels.
#[derive(Clone, Debug)]
pub struct PackedMlp {
    pub(super) layers: Vec<Layer>,
    output_activation: Activation,
}

impl PackedMlp {
    /// Packs a flat parameter buffer.
    pub fn new(config: &MlpConfig, params: &[f32]) -> Self {
        let layers = config
            .layers()
            .map(|(n_in, n_out)| Layer {
                n_in,
                n_out,
                weights: vec![0.0; n_out * padded(n_in)],
                transposed: vec![0.0; n_in * padded(n_out)],
                biases: vec![0.0; padded(n_out)],
            })
            .collect();
        let mut packed = Self { layers, output_activation: config.output_activation };
        packed.pack(params);
        packed
    }

    /// Packs new values of the same shape, without allocating.
    pub fn pack(&mut self, params: &[f32]) {
        let mut rest = params;
        for layer in &mut self.layers {
            let (weights, tail) = rest.split_at(layer.n_in * layer.n_out);
            let (biases, tail) = tail.split_at(layer.n_out);
            rest = tail;
            let stride = padded(layer.n_out);
            for (o, row) in weights.chunks_exact(layer.n_in).enumerate() {
                layer.weights[o * padded(layer.n_in)..][..layer.n_in].copy_from_slice(row);
                for (i, &w) in row.iter().enumerate() {
                    layer.transposed[i * stride + o] = w;
                }
            }
            layer.biases[..layer.n_out].copy_from_slice(biases);
        }
        assert!(rest.is_empty(), "parameters of another shape");
    }

    fn n_inputs(&self) -> usize {
        self.layers[0].n_in
    }

    fn n_outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].n_out
    }
}

/// Gradient of the parameters in the kernels' padded layout.
#[derive(Clone, Debug)]
pub struct MlpGradient {
    /// Per layer `[n_out][padded n_in]`.
    pub(super) weights: Vec<Vec<f32>>,
    /// Per layer `[padded n_out]`.
    pub(super) biases: Vec<Vec<f32>>,
}

impl MlpGradient {
    /// Makes a gradient of zeros.
    pub fn new(packed: &PackedMlp) -> Self {
        Self {
            weights: packed.layers.iter().map(|l| vec![0.0; l.weights.len()]).collect(),
            biases: packed.layers.iter().map(|l| vec![0.0; l.biases.len()]).collect(),
        }
    }

    /// Sets the gradient to zero.
    pub fn clear(&mut self) {
        for values in self.weights.iter_mut().chain(&mut self.biases) {
            values.fill(0.0);
        }
    }

    /// Adds to a flat gradient buffer, laid out as the parameters are.
    pub fn add_to(&self, packed: &PackedMlp, flat: &mut [f32]) {
        let mut rest = flat;
        for ((layer, weights), biases) in packed.layers.iter().zip(&self.weights).zip(&self.biases) {
            let (flat_weights, tail) = rest.split_at_mut(layer.n_in * layer.n_out);
            let (flat_biases, tail) = tail.split_at_mut(layer.n_out);
            rest = tail;
            let rows = weights.chunks_exact(padded(layer.n_in));
            for (flat, row) in flat_weights.chunks_exact_mut(layer.n_in).zip(rows) {
                flat.iter_mut().zip(row).for_each(|(a, b)| *a += b);
            }
            flat_biases.iter_mut().zip(biases).for_each(|(a, b)| *a += b);
        }
        assert!(rest.is_empty(), "gradient of another shape");
    }
}

/// Activations and their gradients of one block.
#[derive(Clone, Debug)]
pub struct MlpScratch {
    /// Output of every layer, `[BLOCK][padded n_out]`.
    outputs: Vec<Vec<f32>>,
    /// Gradient of the sums of every layer, same shapes.
    d_outputs: Vec<Vec<f32>>,
}

impl MlpScratch {
    /// Makes the memory for one block of this network.
    pub fn new(packed: &PackedMlp) -> Self {
        let outputs: Vec<_> = packed.layers.iter().map(|l| vec![0.0; BLOCK * padded(l.n_out)]).collect();
        Self { d_outputs: outputs.clone(), outputs }
    }

    /// Returns the network outputs of the last forward pass, `[BLOCK][padded n_outputs]`.
    pub(crate) fn output(&self) -> &[f32] {
        &self.outputs[self.outputs.len() - 1]
    }

    /// Returns the outputs, and where to put their gradient; `[BLOCK][padded n_outputs]` both. Padding of the gradient
    /// must be zero.
    pub(crate) fn output_and_gradient(&mut self) -> (&[f32], &mut [f32]) {
        let last = self.outputs.len() - 1;
        (&self.outputs[last], &mut self.d_outputs[last])
    }
}

/// Rows of a block of `n` points, padded to whole tiles.
#[inline(always)]
pub(crate) fn rows(n: usize) -> usize {
    n.next_multiple_of(ROWS)
}

/// Computes the forward pass of `rows(n)` points; `x` is `[rows][padded n_inputs]`, finite in every row.
#[inline(always)]
pub(crate) fn forward_block<S: Simd>(simd: S, mlp: &PackedMlp, x: &[f32], n: usize, scratch: &mut MlpScratch) {
    let rows = rows(n);
    assert!(rows <= BLOCK);
    let last = mlp.layers.len() - 1;
    for (l, layer) in mlp.layers.iter().enumerate() {
        let (done, rest) = scratch.outputs.split_at_mut(l);
        let stride = padded(layer.n_in);
        let input = if l == 0 { x } else { &done[l - 1][..] };
        let n_out = padded(layer.n_out);
        gemm::multiply(
            simd,
            &input[..rows * stride],
            stride,
            layer.n_in,
            &layer.transposed,
            n_out,
            Some(&layer.biases),
            l < last,
            &mut rest[0][..rows * n_out],
        );
    }
    if mlp.output_activation == Activation::Sigmoid {
        for y in &mut scratch.outputs[last][..rows * padded(mlp.n_outputs())] {
            *y = 1.0 / (1.0 + (-*y).exp());
        }
    }
}

/// Computes the backward pass after [`forward_block`] of the same `x`. The gradient of the outputs is in the scratch
/// (zero in padding rows and columns); that of the parameters is added to `gradient` if given; that of the inputs is
/// written to `d_x`, `[rows][padded n_inputs]`.
#[inline(always)]
pub(crate) fn backward_block<S: Simd>(
    simd: S,
    mlp: &PackedMlp,
    x: &[f32],
    n: usize,
    scratch: &mut MlpScratch,
    mut gradient: Option<&mut MlpGradient>,
    d_x: &mut [f32],
) {
    let rows = rows(n);
    let last = mlp.layers.len() - 1;
    let MlpScratch { outputs, d_outputs } = scratch;
    if mlp.output_activation == Activation::Sigmoid {
        for (d, &y) in d_outputs[last].iter_mut().zip(&outputs[last]) {
            *d *= y * (1.0 - y);
        }
    }
    for (l, layer) in mlp.layers.iter().enumerate().rev() {
        let (n_in, n_out) = (padded(layer.n_in), padded(layer.n_out));
        let (before, after) = d_outputs.split_at_mut(l);
        let d_sum = &after[0][..rows * n_out];
        let input = if l == 0 { x } else { &outputs[l - 1][..] };
        let input = &input[..rows * n_in];
        if let Some(gradient) = &mut gradient {
            gemm::accumulate_outer(simd, d_sum, n_out, layer.n_out, input, n_in, &mut gradient.weights[l]);
            let biases = &mut gradient.biases[l][..n_out];
            for row in d_sum.chunks_exact(n_out) {
                biases.iter_mut().zip(row).for_each(|(b, d)| *b += d);
            }
        }
        let d_input = if l == 0 { &mut d_x[..rows * n_in] } else { &mut before[l - 1][..rows * n_in] };
        gemm::multiply(simd, d_sum, n_out, layer.n_out, &layer.weights, n_in, None, false, d_input);
        if l > 0 {
            for (d, &y) in d_input.iter_mut().zip(input) {
                *d = if y > 0.0 { *d } else { 0.0 };
            }
        }
    }
}

/// Copies rows of `n` values into rows of `stride` values, zero-padded, and clears the rows after the last.
#[inline(always)]
fn pad_rows(from: &[f32], n: usize, to: &mut [f32], stride: usize) {
    to.fill(0.0);
    for (from, to) in from.chunks_exact(n).zip(to.chunks_exact_mut(stride)) {
        to[..n].copy_from_slice(from);
    }
}

/// Writes the outputs of many points, `x[point][n_inputs]` to `out[point][n_outputs]`. Runs on the calling thread.
pub fn forward(mlp: &PackedMlp, x: &[f32], out: &mut [f32]) {
    struct Forward<'a>(&'a PackedMlp, &'a [f32], &'a mut [f32]);
    impl WithSimd for Forward<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self(mlp, x, out) = self;
            let (n_in, n_out) = (mlp.n_inputs(), mlp.n_outputs());
            let mut scratch = MlpScratch::new(mlp);
            let mut block = vec![0.0; BLOCK * padded(n_in)];
            for (x, out) in x.chunks(BLOCK * n_in).zip(out.chunks_mut(BLOCK * n_out)) {
                pad_rows(x, n_in, &mut block, padded(n_in));
                forward_block(simd, mlp, &block, x.len() / n_in, &mut scratch);
                for (y, out) in scratch.output().chunks_exact(padded(n_out)).zip(out.chunks_exact_mut(n_out)) {
                    out.copy_from_slice(&y[..n_out]);
                }
            }
        }
    }
    assert_eq!(x.len() / mlp.n_inputs(), out.len() / mlp.n_outputs());
    Arch::new().dispatch(Forward(mlp, x, out));
}

/// Adds the parameters' gradient and writes the inputs', given the outputs' of many points. Shapes as in [`forward`].
pub fn backward(mlp: &PackedMlp, x: &[f32], d_out: &[f32], gradient: &mut MlpGradient, d_x: &mut [f32]) {
    struct Backward<'a>(&'a PackedMlp, &'a [f32], &'a [f32], &'a mut MlpGradient, &'a mut [f32]);
    impl WithSimd for Backward<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self(mlp, x, d_out, gradient, d_x) = self;
            let (n_in, n_out) = (mlp.n_inputs(), mlp.n_outputs());
            let mut scratch = MlpScratch::new(mlp);
            let mut block = vec![0.0; BLOCK * padded(n_in)];
            let mut d_block = block.clone();
            let blocks = x.chunks(BLOCK * n_in).zip(d_out.chunks(BLOCK * n_out)).zip(d_x.chunks_mut(BLOCK * n_in));
            for ((x, d_out), d_x) in blocks {
                let n = x.len() / n_in;
                pad_rows(x, n_in, &mut block, padded(n_in));
                forward_block(simd, mlp, &block, n, &mut scratch);
                pad_rows(d_out, n_out, scratch.output_and_gradient().1, padded(n_out));
                backward_block(simd, mlp, &block, n, &mut scratch, Some(gradient), &mut d_block);
                for (d, d_x) in d_block.chunks_exact(padded(n_in)).zip(d_x.chunks_exact_mut(n_in)) {
                    d_x.copy_from_slice(&d[..n_in]);
                }
            }
        }
    }
    assert_eq!(x.len(), d_x.len());
    assert_eq!(x.len() / mlp.n_inputs(), d_out.len() / mlp.n_outputs());
    Arch::new().dispatch(Backward(mlp, x, d_out, gradient, d_x));
}
