//! The training of recipe `paper`: on a GPU, on the CPU, or begun on a GPU that fails and ended on the CPU.

#[cfg(feature = "gpu")]
use std::time::{Duration, Instant};

#[cfg(feature = "gpu")]
use nelu3d_field::device::Device;
#[cfg(feature = "gpu")]
use nelu3d_field::gpu::TrainingReport;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::NeuralSurface;

use super::batch::{RayBatch, TrainingPixels};
use super::checkpoint::{Checkpoint, Reached};
use super::codewords::Codewords;
use super::config;
use super::importance;
#[cfg(feature = "gpu")]
use super::learned;
use super::learned::Learned;
#[cfg(feature = "gpu")]
use super::on_gpu::{DeviceScene, Follower, TrainedParts};
use super::record::{IterationCounts, TrainingRecord, diverged, is_observed_after};
use super::view::{self, RenderedView};
use crate::color_field::CameraRays;
#[cfg(feature = "gpu")]
use crate::color_field::Form;
use crate::reconstruct::context::Context;
use crate::reconstruct::error::Failure;
use crate::reconstruct::observer::Stage;
use crate::reconstruct::options::ReconstructionOptions;
use crate::reconstruct::scene::Scene;

/// A training and its state.
pub(super) struct Training<'a> {
    pub(super) scene: &'a Scene<'a>,
    pub(super) pixels: &'a TrainingPixels,
    pub(super) opts: &'a ReconstructionOptions,
    pub(super) n_steps: usize,
    /// The fields.
    pub(super) learned: Learned,
    /// How far they are; records are of every hundredth iteration and the last.
    pub(super) reached: Reached,
    /// Where the state is kept, if it is.
    pub(super) checkpoint: Option<&'a Checkpoint>,
}

impl Training<'_> {
    /// Trains all iterations.
    pub(super) fn run(&mut self, cx: &mut Context<'_>) -> Result<(), Failure> {
        #[cfg(feature = "gpu")]
        if self.reached.done < self.n_steps {
            self.run_on_gpu(cx)?;
        }
        self.run_on_cpu(cx)
    }

    /// Trains on the device, if it is a GPU: all iterations, or those up to the last state fetched from a device that
    /// failed.
    #[cfg(feature = "gpu")]
    fn run_on_gpu(&mut self, cx: &mut Context<'_>) -> Result<(), Failure> {
        let Device::Gpu(gpu) = cx.device.clone() else { return Ok(()) };
        if let Form::Published(_) = self.scene.field.form {
            cx.progress.warn("recipe `paper` is trained on the CPU, where form `published` is queried");
            return Ok(());
        }
        let (scene, pixels, opts) = (self.scene, self.pixels, self.opts);
        if importance::per_ray(opts.paper.samples, opts.paper.ray_samples).is_some() {
            cx.progress.warn(format!(
                "a GPU marches every ray, so that {} samples an iteration are of fewer rays than on the CPU: take {} \
                 there, as published",
                opts.paper.samples,
                config::PUBLISHED_SAMPLES
            ));
        }
        let on_device = DeviceScene::new(pixels, scene, &opts.paper, self.n_steps, opts.seed);
        let Learned { surface, ambient, occupancy } = &mut self.learned;
        let mut parts = TrainedParts { surface, ambient, occupancy };
        let from = (self.reached.done, self.reached.n_rays);
        let mut kept =
            Kept { scene, pixels, reached: &mut self.reached, checkpoint: self.checkpoint, last: Instant::now() };
        let (done, n_rays) = on_device.train(&gpu, &mut parts, from, self.n_steps, cx, &mut kept)?;
        (self.reached.done, self.reached.n_rays) = (done, n_rays);
        // What a device that failed did after the last state that was fetched is done again.
        self.reached.records.retain(|r| r.iteration <= done);
        Ok(())
    }

    /// Trains the iterations that are left.
    fn run_on_cpu(&mut self, cx: &mut Context<'_>) -> Result<(), Failure> {
        let scene = self.scene;
        let colors = Codewords::of(scene);
        let mut batch = RayBatch::default();
        if self.reached.done == 0 {
            cx.observe(Stage::Refine, 0, || self.render_view().depth);
        }
        while self.reached.done < self.n_steps {
            if cx.progress.cancelled() && self.reached.done > 0 {
                self.save()?;
            }
            cx.stop_if_cancelled()?;
            self.iterate(&colors, &mut batch)?;
            let done = self.reached.done;
            cx.progress.tick(done, self.n_steps);
            if is_observed_after(done, self.n_steps) {
                cx.observe(Stage::Refine, done, || self.render_view().depth);
            }
            if self.checkpoint.is_some_and(|c| c.is_due(done)) {
                self.save()?;
            }
        }
        Ok(())
    }

    /// Trains one iteration.
    fn iterate(&mut self, colors: &Codewords<'_>, batch: &mut RayBatch) -> Result<(), Failure> {
        let Self { scene, pixels, opts, n_steps, learned, reached, .. } = self;
        let (step, seed, settings) = (reached.done, opts.seed, &opts.paper);
        let per_ray = importance::per_ray(settings.samples, settings.ray_samples);
        config::update_occupancy(&mut learned.occupancy, &learned.surface, step as u64, seed);
        let (m, rays) = (&scene.measurements, &scene.rays);
        let (grid, surface) = (&learned.occupancy, &learned.surface);
        batch.draw(pixels, m, rays, colors, grid, surface, reached.n_rays, per_ray, seed, step as u64);
        let anneal = settings.start.anneal(step, *n_steps);
        let losses = batch.step(&mut learned.surface, &mut learned.ambient, anneal);
        let n_samples = batch.n_samples();
        if step % 100 == 0 || step + 1 == *n_steps {
            let counts = IterationCounts {
                inv_s_per_mm: learned.surface.inv_s() / pixels.bounds.unit_mm,
                rays: reached.n_rays,
                samples: n_samples,
                occupied: learned.occupancy.occupied_fraction(),
            };
            reached.records.push(TrainingRecord::new(step + 1, &losses, counts));
            tracing::info!(?losses, record = ?reached.records.last(), "training");
            if !losses.total.is_finite() {
                return Err(diverged(step + 1));
            }
        }
        reached.n_rays = config::next_ray_count(reached.n_rays, n_samples, settings.samples);
        reached.done += 1;
        Ok(())
    }

    /// Writes the checkpoint, if there is to be one.
    fn save(&self) -> Result<(), Failure> {
        let Some(checkpoint) = self.checkpoint else { return Ok(()) };
        Ok(checkpoint.save(&self.reached, &self.learned.parts())?)
    }

    /// Renders the present surface from the camera.
    pub(super) fn render_view(&self) -> RenderedView {
        let (rays, n) = (&self.scene.rays, self.scene.measurements.n());
        render_view(&self.learned.surface, self.pixels, rays, &self.learned.occupancy, n)
    }
}

/// What is recorded and kept of a training on a device.
#[cfg(feature = "gpu")]
struct Kept<'a> {
    scene: &'a Scene<'a>,
    pixels: &'a TrainingPixels,
    reached: &'a mut Reached,
    checkpoint: Option<&'a Checkpoint>,
    /// When the checkpoint was written, or the training began.
    last: Instant,
}

/// Time between two checkpoints of a device's state: writing one takes as long as a hundred iterations.
#[cfg(feature = "gpu")]
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(30);

#[cfg(feature = "gpu")]
impl Follower for Kept<'_> {
    fn report(&mut self, report: &TrainingReport, done: usize) -> bool {
        let counts = IterationCounts {
            inv_s_per_mm: report.inv_s / self.pixels.bounds.unit_mm,
            rays: report.n_rays,
            samples: report.n_samples,
            occupied: report.occupied,
        };
        self.reached.records.push(TrainingRecord::new(done, &report.losses, counts));
        report.losses.total.is_finite()
    }

    fn fetched(&mut self, parts: &TrainedParts<'_>, done: usize, n_rays: usize, stopping: bool) -> Result<(), Failure> {
        (self.reached.done, self.reached.n_rays) = (done, n_rays);
        let Some(checkpoint) = self.checkpoint else { return Ok(()) };
        if done > 0 && (stopping || self.last.elapsed() >= BETWEEN_CHECKPOINTS) {
            checkpoint.save(self.reached, &learned::parts(parts.surface, parts.ambient, parts.occupancy))?;
            self.last = Instant::now();
        }
        Ok(())
    }

    fn render_depth(&self, parts: &TrainedParts<'_>) -> Vec<f32> {
        let (rays, n) = (&self.scene.rays, self.scene.measurements.n());
        render_view(parts.surface, self.pixels, rays, parts.occupancy, n).depth
    }
}

/// Renders a surface at the lit pixels.
fn render_view(
    surface: &NeuralSurface,
    pixels: &TrainingPixels,
    rays: &CameraRays,
    grid: &OccupancyGrid,
    n_pixels: usize,
) -> RenderedView {
    let mut out = RenderedView::empty(n_pixels);
    let lit: Vec<usize> = pixels.lit().collect();
    let marches: Vec<_> = lit.iter().map(|&i| pixels.march(rays, i, 0.5)).collect();
    let rendered = view::render(surface, &pixels.bounds, grid, &marches);
    let normals = view::normals(surface, &pixels.bounds, &marches, &rendered.t);
    for (r, &i) in lit.iter().enumerate() {
        out.depth[i] = rendered.t[r] * rays.dir_z(i);
        out.spread[i] = rendered.spread[r] * rays.dir_z(i);
        out.normals[i] = normals[r];
    }
    out
}
