//! The training loop of TurboSL.

use nelu3d::progress::Progress;
use nelu3d::reconstruct::neural::checkpoint::{Identity, Reached, SceneDigest};
use nelu3d::reconstruct::neural::{TrainingRecord, config, importance};
use nelu3d_field::occupancy::OccupancyGrid;

use super::options::TurboSlOptions;
use super::scene::TurboSlScene;
use super::step::Model;
use crate::error::DecodeError;

/// Trains a model of a scene; returns it with its occupancy grid and what is recorded of the training.
///
/// # Errors
///
/// The training diverged, the caller stopped it, or its checkpoint cannot be used or written.
pub(super) fn train(
    scene: &TurboSlScene<'_>,
    opts: &TurboSlOptions,
    progress: &Progress,
) -> Result<(Model, OccupancyGrid, Vec<TrainingRecord>), DecodeError> {
    let mut model = Model::new(scene, opts);
    let mut grid = OccupancyGrid::new(config::occupancy_config(opts.steps), |q| scene.reaches(q));
    let checkpoint = opts.checkpoint.of(|| identity(scene, opts));
    let resumed = checkpoint.as_ref().map(|c| c.load(&mut model.parts_mut(&mut grid))).transpose()?.flatten();
    let mut reached = resumed.unwrap_or_default();
    let save = |model: &Model, grid: &OccupancyGrid, reached: &Reached| match &checkpoint {
        Some(checkpoint) => checkpoint.save(reached, &model.parts(grid)),
        None => Ok(()),
    };
    // Of 10,000 iterations: from the 1,000th on.
    let reverse_from = opts.steps / 10;
    let per_ray = importance::per_ray(opts.samples, opts.ray_samples);
    let n_steps = opts.stop_after.unwrap_or(opts.steps).min(opts.steps);
    while reached.done < n_steps {
        let step = reached.done;
        if progress.cancelled() {
            if step > 0 {
                save(&model, &grid, &reached)?;
            }
            return Err(DecodeError::Cancelled);
        }
        config::update_occupancy(&mut grid, &model.surface, step as u64, opts.seed);
        let reverse = (!opts.no_reverse).then_some(if step >= reverse_from { 1.0 } else { 0.0 });
        let anneal = config::anneal(step, opts.steps);
        let seed = opts.seed.wrapping_mul(0x9E37_79B9).wrapping_add(step as u64);
        let n_rays = reached.n_rays;
        let (losses, n_samples) = model.step(scene, &grid, n_rays, per_ray, reverse, anneal, seed);
        if step % 100 == 0 || step + 1 == n_steps {
            let (inv_s, occupied) = (model.surface.inv_s(), grid.occupied_fraction());
            tracing::info!(?losses, inv_s, n_rays, n_samples, occupied, blur = ?model.blur[0].taps(), step);
            reached.records.push(TrainingRecord {
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
        reached.n_rays = config::next_ray_count(n_rays, n_samples, opts.samples);
        reached.done += 1;
        progress.tick(reached.done, n_steps);
        if checkpoint.as_ref().is_some_and(|c| c.is_due(reached.done)) || reached.done == n_steps {
            save(&model, &grid, &reached)?;
        }
    }
    // What `stop_after` left can go on.
    if let Some(checkpoint) = checkpoint.filter(|_| reached.done == opts.steps) {
        checkpoint.remove();
    }
    Ok((model, grid, reached.records))
}

/// Returns what a checkpoint must have been made of to go on with it: how far a training goes is not part of that.
fn identity(scene: &TurboSlScene<'_>, opts: &TurboSlOptions) -> Identity {
    let settings = TurboSlOptions { stop_after: None, ..opts.clone() };
    let mut digest = SceneDigest::default();
    scene.digest(&mut digest);
    Identity::new("turbosl", &settings, digest)
}
