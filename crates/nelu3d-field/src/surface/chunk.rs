//! Memory of a step.

use super::losses::SurfaceLosses;
use super::ray_loss::RayScratch;
use crate::mlp::cpu::{MlpGradient, PackedMlp};
use crate::mlp::gradient::GradientScratch;
use std::ops::Range;

/// Memory of a step, kept for the next one.
#[derive(Debug, Default)]
pub(super) struct StepScratch {
    pub(super) blocks: Vec<Range<usize>>,
    pub(super) chunks: Vec<Chunk>,
}

impl Clone for StepScratch {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Sums and scratch of a few blocks.
#[derive(Debug)]
pub(super) struct Chunk {
    /// Samples of this chunk.
    pub(super) samples: Range<usize>,
    pub(super) gradient: MlpGradient,
    pub(super) losses: SurfaceLosses,
    pub(super) d_inv_s: f64,
    /// Values that the rays send back to the caller.
    pub(super) ray_outputs: Vec<f32>,
    /// Values that their samples send back to the caller.
    pub(super) sample_outputs: Vec<f32>,
    /// Gradients of the signed distance by the features, `[level][point][feature]`.
    pub(super) d_features: Vec<f32>,
    /// s = ∂L/∂f of every point.
    pub(super) s: Vec<f32>,
    /// u = ∂L/∂(∂f/∂x), per unit of x, `[axis][point]`.
    pub(super) u: [Vec<f32>; 3],
    // The rest is of one block.
    /// Network inputs, `[row][stride]`.
    pub(super) x: Vec<f32>,
    /// Gradients of f by the network inputs.
    pub(super) d_x: Vec<f32>,
    /// Jacobians of the eikonal points' inputs, `[point][axis][stride]`.
    pub(super) jacobian: Vec<f32>,
    /// The directions along which the eikonal loss acts on the network inputs, `[row][stride]`.
    pub(super) tangents: Vec<f32>,
    pub(super) sdf: Vec<f32>,
    /// Gradients of f in space, at the eikonal points.
    pub(super) g: Vec<[f32; 3]>,
    /// Gradients of the image formation by them.
    pub(super) d_g: Vec<[f32; 3]>,
    /// Scratch memory of one ray.
    pub(super) ray: RayScratch,
    pub(super) network: GradientScratch,
}

impl Chunk {
    pub(super) fn new(packed: &PackedMlp) -> Self {
        Self {
            samples: 0..0,
            gradient: MlpGradient::new(packed),
            losses: SurfaceLosses::default(),
            d_inv_s: 0.0,
            ray_outputs: Vec::new(),
            sample_outputs: Vec::new(),
            d_features: Vec::new(),
            s: Vec::new(),
            u: Default::default(),
            x: Vec::new(),
            d_x: Vec::new(),
            jacobian: Vec::new(),
            tangents: Vec::new(),
            sdf: Vec::new(),
            g: Vec::new(),
            d_g: Vec::new(),
            ray: RayScratch::default(),
            network: GradientScratch::default(),
        }
    }
}

/// Grows a buffer, never shrinks it: what is there is overwritten before it is read.
pub(super) fn reserve(values: &mut Vec<f32>, n: usize) {
    if values.len() < n {
        values.resize(n, 0.0);
    }
}
