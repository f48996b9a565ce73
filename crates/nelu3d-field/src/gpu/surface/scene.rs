//! What a surface is trained on, and what is reported of the training.

use crate::lattice::{Lattice, ProjectiveFrame};
use crate::surface::SurfaceLosses;
use bytemuck::{Pod, Zeroable};

/// A pixel that rays are drawn from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ScenePixel {
    /// Direction of its ray, in the cube's units per unit of t.
    pub dir: [f32; 3],
    /// The t at which the cube and the field begin.
    pub near: f32,
    /// Its position in the unit square, for the ambient term.
    pub place: [f32; 2],
    /// The t at which the cube and the field end.
    pub far: f32,
    /// The mask M, 0 or 1.
    pub mask: f32,
}

/// The meaning of the ambient network's output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AmbientUse {
    /// There is no ambient light.
    None,
    /// The output is the ambient fraction A.
    Fraction,
    /// The output is I_ambient; the fraction is that divided by I_white, or by `min_white` if that is more.
    Intensity {
        /// The least I_white that is divided by.
        min_white: f32,
    },
}

/// The rays that a surface is trained on.
#[derive(Clone, Copy, Debug)]
pub struct RayScene<'a> {
    /// The pixels.
    pub pixels: &'a [ScenePixel],
    /// Where all rays begin, in the cube's coordinates.
    pub origin: [f32; 3],
    /// Distance of samples along a ray.
    pub step: f32,
    /// Measured codewords, `[pixel][k]`.
    pub measured: &'a [f32],
    /// I_white, `[pixel][channel]`.
    pub white: &'a [f32],
    /// Channels of the camera; pattern j is seen by channel j mod that.
    pub n_channels: usize,
    /// The frozen color field c.
    pub lattice: Lattice<'a>,
    /// Rows of the affine map from the cube's coordinates (and 1) to those along the axes of `frame`.
    pub affine: [[f32; 4]; 3],
    /// The frame of the color field.
    pub frame: ProjectiveFrame,
    /// The ambient term.
    pub ambient: AmbientUse,
    /// Samples that a step should have.
    pub n_samples: usize,
    /// Steps of this training that are done: draws, annealing, learning rates and the occupancy grid go on from there.
    pub first_step: usize,
    /// Rays of the step after these.
    pub first_rays: usize,
    /// The most rays of a step.
    pub max_rays: usize,
    /// Half a step, in the unit of the distance: half of the intervals around samples, and of the length over which a
    /// cell's alpha is computed.
    pub half_step: f32,
    /// Number of steps over which the cosine of the alphas is annealed, from r = 0 to 1; 0 for 1 from the start on.
    pub anneal_steps: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl RayScene<'_> {
    /// The affine map of a color field whose frame's axes are the cube's.
    pub const CUBE: [[f32; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

    /// Panics if a length does not fit.
    pub(super) fn check(&self) {
        let n_pixels = self.pixels.len();
        assert!(n_pixels > 0 && self.measured.len() == n_pixels * self.lattice.k);
        assert_eq!(self.white.len(), n_pixels * self.n_channels);
        self.lattice.check();
    }
}

/// The state of a training.
#[derive(Clone, Copy, Debug)]
pub struct TrainingReport {
    /// Losses of the last step.
    pub losses: SurfaceLosses,
    /// Rays of the last step.
    pub n_rays: usize,
    /// Samples of the last step.
    pub n_samples: usize,
    /// inv_s after it.
    pub inv_s: f64,
    /// Fraction of the cells that are occupied.
    pub occupied: f64,
}
