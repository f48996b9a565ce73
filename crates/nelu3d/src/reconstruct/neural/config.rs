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

/// Weight of the mask loss, as published.
pub const MASK_WEIGHT: f64 = 0.1;

/// Returns the optimizer of a field over `n_steps` steps: warm-up from 1 % over 500 steps, then exponential decay to a
/// tenth.
fn training(learning_rate: f64, n_steps: usize) -> TrainConfig {
    let n_warmup_steps = 500.min(n_steps as u64 / 4);
    TrainConfig {
        adam: AdamConfig { beta1: 0.9, beta2: 0.99, epsilon: 1e-15 },
        encoding_learning_rate: learning_rate,
        network_learning_rate: learning_rate,
        schedule: Schedule { n_warmup_steps, warmup_start: 0.01, n_steps: n_steps as u64, final_factor: 0.1 },
        ..TrainConfig::default()
    }
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

/// Returns the published signed distance field (method.md §3): 2^19 entries, xyz appended, 2 × 64 ReLU with weight
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
    SurfaceConfig { field, extent: [SIDE as f32; 3], sharpness: 0.3, sharpness_learning_rate: LEARNING_RATE, loss }
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

/// Returns the settings of the occupancy grid: 128³ cells, threshold 1e-3.
pub fn occupancy_config() -> OccupancyConfig {
    OccupancyConfig::default()
}

/// Updates the occupancy grid's cells: a cell's alpha is that of a surface seen head on over one step,
/// (Φ(f + h) − Φ(f − h) + 1e-5) / (Φ(f + h) + 1e-5) with h half a step (TurboSL's published configuration).
pub fn update_occupancy(grid: &mut OccupancyGrid, surface: &NeuralSurface, step: u64, seed: u64) {
    let inv_s = surface.inv_s() as f32;
    let half = (0.5 * SIDE * 3f64.sqrt() / STEPS_PER_DIAGONAL) as f32;
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
