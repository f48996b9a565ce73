//! The published configuration of a signed distance field in a box, trained and rendered through rays: what recipe
//! `paper` and TurboSL share (TurboSL's public configuration).
//!
//! The box is a cube of [`SIDE`] units; distances, inv_s and the losses are in units, everything outside this module in
//! mm.

use nelu3d_field::adam::{AdamConfig, Schedule};
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::field::TrainConfig;
use nelu3d_field::mlp::Activation;
use nelu3d_field::occupancy::{OccupancyConfig, OccupancyGrid};
use nelu3d_field::surface::{NeuralSurface, SurfaceConfig, SurfaceLoss};
use nelu3d_field::{HashFieldConfig, Real};

use super::bounds::SIDE;

/// Growth of the resolution from level to level of every hash grid here.
const PER_LEVEL_SCALE: f64 = 1.447_269_237_440_378;
/// Number of steps along a cube's diagonal.
pub const STEPS_PER_DIAGONAL: f64 = 1024.0;

/// Number of iterations of the published training, by which its schedules are stated.
pub const PUBLISHED_STEPS: usize = 10_000;
/// Number of samples of an iteration of the published training.
pub const PUBLISHED_SAMPLES: usize = 262_144;

/// v of inv_s = exp(10 v) at the start of the published training.
pub const PUBLISHED_SHARPNESS: f64 = 0.3;

/// Weight of the mask loss, as published.
pub const MASK_WEIGHT: f64 = 0.1;

/// Returns the distance between two samples of a marched ray, units.
pub fn step_units() -> f32 {
    (SIDE * 3f64.sqrt() / STEPS_PER_DIAGONAL) as f32
}

/// Returns how far the cosine of the alphas is annealed at a step of a training of `n_steps`, from 0 to 1.
pub fn anneal(step: usize, n_steps: usize) -> f32 {
    (step as f64 / anneal_steps(n_steps) as f64).min(1.0) as f32
}

/// Returns the number of steps over which the cosine of the alphas is annealed: 20,000 of a training of 10,000, in
/// proportion in shorter ones.
pub fn anneal_steps(n_steps: usize) -> usize {
    (2 * n_steps).max(1)
}

/// Returns the optimizer of a field over `n_steps` steps: warm-up from 1 % over 500 of 10,000 steps, in proportion in
/// shorter trainings, then exponential decay to a tenth.
fn training(learning_rate: f64, n_steps: usize) -> TrainConfig {
    let n_warmup_steps = scaled(500, n_steps) as u64;
    TrainConfig {
        adam: AdamConfig { beta1: 0.9, beta2: 0.99, epsilon: 1e-15 },
        encoding_learning_rate: learning_rate,
        network_learning_rate: learning_rate,
        schedule: Schedule { n_warmup_steps, warmup_start: 0.01, n_steps: n_steps as u64, final_factor: 0.1 },
        ..TrainConfig::default()
    }
}

/// Raises the learning rates of recipe `paper`'s surface in a training of `n_steps` steps: a shorter one than the
/// published takes larger steps, by the root of what it is shorter, at most fourfold.
///
/// Not for TurboSL, whose surface is shaded by its normals: at such rates the finest levels of the hash grid tilt them
/// until they explain the patterns wherever the surface is (a ball after 400 iterations: normals 60° off, depth 14 mm
/// instead of 2).
pub fn hasten(config: &mut SurfaceConfig, n_steps: usize) {
    let factor = (PUBLISHED_STEPS as f64 / n_steps.max(1) as f64).sqrt().clamp(1.0, 4.0);
    config.field.training.encoding_learning_rate *= factor;
    config.field.training.network_learning_rate *= factor;
    config.sharpness_learning_rate *= factor;
}

/// Makes the warm-up of a training four times as long: for a surface that is nearly right at the start. The first steps
/// of Adam are as long as the learning rate whatever the gradient is, so that a good surface is shaken by them.
pub(super) fn warm_up_longer(config: &mut SurfaceConfig) {
    config.field.training.schedule.n_warmup_steps *= 4;
}

/// Returns the part of a training of `n_steps` steps that `steps` are of the published one, no more than `steps`.
fn scaled(steps: usize, n_steps: usize) -> usize {
    (steps * n_steps / PUBLISHED_STEPS).clamp(1, steps)
}

/// Returns a hash grid of 16 levels of 2 features, base 16.
fn encoding<const D: usize>(log2_hashmap_size: u32) -> HashGridConfig<D> {
    let finest = (16.0 * PER_LEVEL_SCALE.powi(15)).round() as u32;
    HashGridConfig {
        n_levels: 16,
        n_features_per_level: 2,
        log2_hashmap_size,
        base_resolution: [16; D],
        finest_resolution: [finest; D],
    }
}

/// Returns the published signed distance field (method.md §3): 2^19 entries, 2x − 1 appended, 2 × 64 ReLU with weight
/// normalization, learning rate 8e-4, inv_s = exp(10 v) with v = 0.3 at the start.
pub fn surface_config(loss: SurfaceLoss, n_steps: usize) -> SurfaceConfig {
    const LEARNING_RATE: f64 = 8e-4;
    let field = HashFieldConfig {
        encoding: encoding(19),
        n_outputs: 1,
        width: 64,
        n_hidden_layers: 2,
        output_activation: Activation::Linear,
        append_position: true,
        training: TrainConfig { weight_normalization: true, ..training(LEARNING_RATE, n_steps) },
    };
    SurfaceConfig {
        field,
        extent: [SIDE as f32; 3],
        sharpness: PUBLISHED_SHARPNESS,
        sharpness_learning_rate: LEARNING_RATE,
        loss,
    }
}

/// Returns the published field over an image (ambient, albedo): 2^15 entries, 2 × 64, sigmoid, learning rate 8e-3.
pub fn image_field_config(n_outputs: usize, n_steps: usize) -> HashFieldConfig<2> {
    HashFieldConfig {
        encoding: encoding(15),
        n_outputs,
        width: 64,
        n_hidden_layers: 2,
        output_activation: Activation::Sigmoid,
        append_position: false,
        training: training(8e-3, n_steps),
    }
}

/// Returns the settings of the occupancy grid: 128³ cells, threshold 1e-3, all cells for the first 256 of 10,000 steps,
/// in proportion in shorter trainings.
pub fn occupancy_config(n_steps: usize) -> OccupancyConfig {
    let published = OccupancyConfig::default();
    let n_warmup_steps = scaled(published.n_warmup_steps as usize, n_steps) as u64;
    OccupancyConfig { n_warmup_steps, ..published }
}

/// Updates the occupancy grid's cells: a cell's alpha is that of a surface seen head on over one step,
/// (Φ(f + h) − Φ(f − h) + 1e-5) / (Φ(f + h) + 1e-5) with h half a step (TurboSL's published configuration).
pub fn update_occupancy(grid: &mut OccupancyGrid, surface: &NeuralSurface, step: u64, seed: u64) {
    let inv_s = surface.inv_s() as f32;
    let half = 0.5 * step_units();
    grid.update(step, seed, |points, alpha| {
        surface.field().query(points, alpha);
        for a in alpha {
            let (before, after) = ((inv_s * (*a + half)).sigmoid(), (inv_s * (*a - half)).sigmoid());
            *a = ((before - after + 1e-5) / (before + 1e-5)).clamp(0.0, 1.0);
        }
    });
}

/// Returns the number of rays of the next step: it grows from [`FIRST_RAYS`] towards [`MAX_RAYS`] while a step has
/// fewer samples than `target`.
pub fn next_ray_count(n_rays: usize, n_samples: usize, target: usize) -> usize {
    if n_samples == 0 {
        return MAX_RAYS;
    }
    let wanted = n_rays as f64 * target as f64 / n_samples as f64;
    ((0.9 * n_rays as f64 + 0.1 * wanted) as usize).clamp(16, MAX_RAYS)
}

/// Number of rays of the first step.
pub const FIRST_RAYS: usize = 256;
/// Largest number of rays of a step.
pub const MAX_RAYS: usize = 8192;
