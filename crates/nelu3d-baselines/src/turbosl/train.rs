//! The training loop of TurboSL.

use nelu3d::progress::Progress;
use nelu3d::reconstruct::neural::{TrainingRecord, config, importance};
use nelu3d_field::HashField;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::SurfaceLoss;

use super::blur::Blur;
use super::options::TurboSlOptions;
use super::scene::TurboSlScene;
use super::step::Model;
use crate::error::DecodeError;

/// Trains a model of a scene; returns it with its occupancy grid and what is recorded of the training.
///
/// # Errors
///
/// The training diverged, or the caller stopped it.
pub(super) fn train(
    scene: &TurboSlScene<'_>,
    opts: &TurboSlOptions,
    progress: &Progress,
) -> Result<(Model, OccupancyGrid, Vec<TrainingRecord>), DecodeError> {
    let loss = SurfaceLoss { mask_weight: config::MASK_WEIGHT, ..SurfaceLoss::default() };
    let image_field = |seed| {
        let config = config::image_field_config(scene.n_channels, opts.steps);
        HashField::new(config, seed).expect("the published configuration is valid")
    };
    let mut model = Model {
        surface: opts.start.surface(config::surface_config(loss, opts.steps), opts.seed),
        albedo: image_field(opts.seed.wrapping_add(1)),
        ambient: image_field(opts.seed.wrapping_add(2)),
        blur: [Blur::new(), Blur::new()],
    };
    let mut grid = OccupancyGrid::new(config::occupancy_config(opts.steps), |q| scene.reaches(q));
    // Of 10,000 iterations: from the 1,000th on.
    let reverse_from = opts.steps / 10;
    let per_ray = importance::per_ray(opts.samples, opts.ray_samples);
    let mut n_rays = config::FIRST_RAYS;
    let mut records = Vec::new();
    let n_steps = opts.stop_after.unwrap_or(opts.steps).min(opts.steps);
    for step in 0..n_steps {
        if progress.cancelled() {
            return Err(DecodeError::Cancelled);
        }
        config::update_occupancy(&mut grid, &model.surface, step as u64, opts.seed);
        let reverse = (!opts.no_reverse).then_some(if step >= reverse_from { 1.0 } else { 0.0 });
        let anneal = config::anneal(step, opts.steps);
        let seed = opts.seed.wrapping_mul(0x9E37_79B9).wrapping_add(step as u64);
        let (losses, n_samples) = model.step(scene, &grid, n_rays, per_ray, reverse, anneal, seed);
        if step % 100 == 0 || step + 1 == n_steps {
            let (inv_s, occupied) = (model.surface.inv_s(), grid.occupied_fraction());
            tracing::info!(?losses, inv_s, n_rays, n_samples, occupied, blur = ?model.blur[0].taps(), step);
            records.push(TrainingRecord {
                iteration: step + 1,
                image: losses.image,
                mask: losses.mask,
                eikonal: losses.eikonal,
                sparsity: losses.sparsity,
                inv_s_per_mm: inv_s / scene.bounds.unit_mm,
                rays: n_rays,
                samples: n_samples,
                occupied,
            });
            if !losses.total.is_finite() {
                let problem = format!("led to a loss that is no number at iteration {}; try another", step + 1);
                return Err(DecodeError::Setting { setting: "seed", problem });
            }
        }
        n_rays = config::next_ray_count(n_rays, n_samples, opts.samples);
        progress.tick(step + 1, n_steps);
    }
    Ok((model, grid, records))
}
