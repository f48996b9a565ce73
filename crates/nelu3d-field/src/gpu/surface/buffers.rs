//! The buffers of a training that belong to neither network.

use super::super::Gpu;
use super::super::net::{Net, Shared, schedule};
use super::super::program::Buffer;
use super::scene::{RayScene, ScenePixel};
use crate::device::DeviceError;
use crate::field::HashField;
use crate::occupancy::OccupancyGrid;
use crate::surface::NeuralSurface;

/// Indices of the numbers in [`Buffers::control`] that change from step to step.
pub(super) mod control {
    /// Samples of the step.
    pub(in super::super) const N_AT: usize = 0;
    /// Steps done.
    pub(in super::super) const STEP_AT: usize = 1;
    /// Rays of the step.
    pub(in super::super) const RAYS_AT: usize = 2;
    /// Picked cells of the occupancy grid.
    pub(in super::super) const PICKED_AT: usize = 3;
    /// Batch of picked cells.
    pub(in super::super) const BATCH_AT: usize = 4;
    /// First picked cell of the batch.
    pub(in super::super) const BEGIN_AT: usize = 5;
    /// Samples of the step, saved while cells are evaluated.
    pub(in super::super) const SAVED_AT: usize = 6;
    /// How many numbers there are.
    pub(in super::super) const N: usize = 8;
}

/// Index of the surface's rates in [`Buffers::rates`].
const SURFACE_RATES: usize = 0;
/// Index of the ambient network's rates in [`Buffers::rates`].
const AMBIENT_RATES: usize = 4;

/// Parts that the occupancy grid's cells are cut into where their values are summed.
pub(super) const N_PARTS: usize = 256;

/// The buffers.
#[derive(Debug)]
pub(super) struct Buffers {
    /// See [`control`].
    pub(super) control: Buffer<u32>,
    /// Rates of the two optimizers in this step.
    pub(super) rates: Buffer,
    /// Rates of both in all steps, by turns.
    pub(super) schedule: Buffer<[f32; 4]>,
    pub(super) pixels: Buffer<ScenePixel>,
    /// `[pixel][measured codeword, I_white]`
    pub(super) measured: Buffer,
    /// Coefficients of the color field.
    pub(super) nodes: Buffer,
    /// Frame of the color field.
    pub(super) frame: Buffer<[f32; 4]>,
    /// First sample, number of samples and pixel of every ray.
    pub(super) rays: Buffer<[u32; 4]>,
    /// Codewords of samples, `[k][sample]`.
    pub(super) colors: Buffer,
    /// Transmittances before the samples; then s, the gradients by their distances.
    pub(super) s: Buffer,
    /// The distances' gradients in space; then u, the gradients by them, and shares of the eikonal loss.
    pub(super) u: Buffer<[f32; 4]>,
    /// Losses of rays.
    pub(super) of_ray: Buffer<[f32; 4]>,
    /// Losses of the step.
    pub(super) losses: Buffer<[f32; 4]>,
    /// v, its two moments, and inv_s.
    pub(super) sharpness: Buffer,
    /// Cells of the occupancy grid that exist.
    pub(super) cells: Buffer<u32>,
    /// Values of the occupancy grid.
    pub(super) values: Buffer,
    /// Occupied cells, a bit each.
    pub(super) occupied: Buffer<u32>,
    /// Cells that are looked at again.
    pub(super) picked: Buffer<u32>,
    /// Sums of parts of the values.
    pub(super) parts: Buffer,
    /// The value above which a cell is occupied.
    pub(super) threshold: Buffer,
}

impl Buffers {
    /// Uploads what is known and makes room for the rest, for `n_steps` steps with those that are done.
    pub(super) fn new(
        gpu: &Gpu,
        [net, ambient_net]: [&Net; 2],
        surface: &NeuralSurface,
        ambient: &HashField<2>,
        occupancy: &OccupancyGrid,
        scene: &RayScene<'_>,
        n_steps: usize,
    ) -> Result<Self, DeviceError> {
        let (n, n_rays, k) = (net.capacity, ambient_net.capacity, scene.lattice.k);
        let mut numbers = [0u32; control::N];
        numbers[control::STEP_AT] = scene.first_step as u32;
        numbers[control::RAYS_AT] = scene.first_rays as u32;
        let done = scene.first_step as u64;
        let [first, second] = [
            schedule(&surface.config.field.training, surface.field.n_steps() - done, n_steps),
            schedule(&ambient.config.training, ambient.n_steps() - done, n_steps),
        ];
        let both: Vec<[f32; 4]> = first.into_iter().zip(second).flat_map(|(a, b)| [a, b]).collect();
        let measured: Vec<f32> = scene
            .measured
            .chunks_exact(k)
            .zip(scene.white.chunks_exact(scene.n_channels))
            .flat_map(|(p, w)| p.iter().chain(w))
            .copied()
            .collect();
        let moments = &surface.sharpness_moments;
        let sharpness = [surface.sharpness, moments.first[0], moments.second[0], surface.inv_s() as f32];
        let words: Vec<u32> = occupancy.occupied.iter().flat_map(|w| [*w as u32, (*w >> 32) as u32]).collect();
        Ok(Self {
            control: gpu.upload("control", &numbers)?,
            rates: gpu.zeros("rates", 8)?,
            schedule: gpu.upload("schedule", &both)?,
            pixels: gpu.upload("pixels", scene.pixels)?,
            measured: gpu.upload("measured codewords", &measured)?,
            nodes: gpu.upload("the color field", scene.lattice.nodes)?,
            frame: gpu.upload("the color field's frame", &frame(scene))?,
            rays: gpu.zeros("rays", n_rays)?,
            colors: gpu.zeros("codewords", n * k)?,
            s: gpu.zeros("gradients of distances", n)?,
            u: gpu.zeros("gradients of slopes", n)?,
            of_ray: gpu.zeros("losses of rays", n_rays)?,
            losses: gpu.zeros("losses", 1)?,
            sharpness: gpu.upload("sharpness", &sharpness)?,
            cells: gpu.upload("cells", &occupancy.cells)?,
            values: gpu.upload("occupancy", &occupancy.values)?,
            occupied: gpu.upload("occupied cells", &words)?,
            picked: gpu.zeros("picked cells", occupancy.cells.len())?,
            parts: gpu.zeros("sums of the occupancy", N_PARTS)?,
            threshold: gpu.zeros("threshold", 1)?,
        })
    }

    /// Returns what the surface's net shares with the rest of the step.
    pub(super) fn shared(&self) -> Shared<'_> {
        Shared { control: &self.control, n_at: control::N_AT, rates: &self.rates, rates_at: SURFACE_RATES }
    }

    /// Returns what the ambient net shares with the rest of the step.
    pub(super) fn shared_ambient(&self) -> Shared<'_> {
        Shared { control: &self.control, n_at: control::RAYS_AT, rates: &self.rates, rates_at: AMBIENT_RATES }
    }
}

/// Returns the color field's frame as the shader reads it: affine map, kappa, lower corner, scale.
fn frame(scene: &RayScene<'_>) -> [[f32; 4]; 6] {
    let [lo, scale] = [scene.frame.lo, scene.frame.scale].map(|v| [v[0] as f32, v[1] as f32, v[2] as f32, 0.0]);
    let [m0, m1, m2] = scene.affine;
    [m0, m1, m2, [scene.frame.kappa as f32, 0.0, 0.0, 0.0], lo, scale]
}
