//! The training of recipe `paper`: on a GPU, on the CPU, or begun on a GPU that fails and ended on the CPU.

#[cfg(feature = "gpu")]
use nelu3d_field::device::Device;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::{NeuralSurface, SurfaceConfig, SurfaceLoss};

use super::ambient::AmbientField;
use super::batch::{RayBatch, TrainingPixels};
use super::codewords::Codewords;
use super::config;
use super::importance;
use super::lookup_start::DecodedBody;
#[cfg(feature = "gpu")]
use super::on_gpu;
use super::options::Background;
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
    scene: &'a Scene<'a>,
    pixels: &'a TrainingPixels,
    opts: &'a ReconstructionOptions,
    n_steps: usize,
    surface: NeuralSurface,
    /// The ambient term.
    pub(super) ambient: AmbientField,
    occupancy: OccupancyGrid,
    n_rays: usize,
    /// Records of every hundredth iteration and the last.
    pub(super) records: Vec<TrainingRecord>,
}

impl<'a> Training<'a> {
    /// Initializes the fields. `decoded` is the depth map from which training starts, camera z in mm, if it does.
    pub(super) fn new(
        scene: &'a Scene<'a>,
        pixels: &'a TrainingPixels,
        opts: &'a ReconstructionOptions,
        n_steps: usize,
        decoded: Option<&[f32]>,
    ) -> Self {
        let settings = &opts.paper;
        let loss = SurfaceLoss {
            lookup_loss_weight: settings.lookup_loss_weight,
            clamped_mask: settings.background != Background::Carve,
            ..SurfaceLoss::default()
        };
        let occupancy =
            OccupancyGrid::new(config::occupancy_config(n_steps), |q| pixels.reaches(scene.camera, &scene.rays, q));
        let sharpness = settings.sharpness.unwrap_or(settings.start.sharpness());
        let mut config = SurfaceConfig { sharpness, ..config::surface_config(loss, n_steps) };
        config::hasten(&mut config, n_steps);
        let body = decoded.and_then(|z| DecodedBody::new(scene.camera, pixels.bounds, &scene.rays.plane, z));
        let surface = match body {
            Some(body) => body.surface(config, opts.seed),
            None => settings.start.shape().unwrap_or_default().surface(config, opts.seed),
        };
        Self {
            scene,
            pixels,
            opts,
            n_steps,
            surface,
            ambient: AmbientField::new(settings.ambient, scene.white.channels, n_steps, opts.seed),
            occupancy,
            n_rays: config::FIRST_RAYS,
            records: Vec::new(),
        }
    }

    /// Trains all iterations.
    pub(super) fn run(&mut self, cx: &mut Context<'_>) -> Result<(), Failure> {
        #[cfg(feature = "gpu")]
        let done = self.run_on_gpu(cx)?;
        #[cfg(not(feature = "gpu"))]
        let done = 0;
        self.run_on_cpu(done, cx)
    }

    /// Trains on the device, if it is a GPU; returns the number of iterations that are done: all, or those up to the
    /// last checkpoint of a device that failed.
    #[cfg(feature = "gpu")]
    fn run_on_gpu(&mut self, cx: &mut Context<'_>) -> Result<usize, Failure> {
        let Device::Gpu(gpu) = cx.device.clone() else { return Ok(0) };
        if let Form::Published(_) = self.scene.field.form {
            cx.progress.warn("recipe `paper` is trained on the CPU, where form `published` is queried");
            return Ok(0);
        }
        cx.progress.warn(
            "on a GPU, recipe `paper` marches every ray and takes alphas between neighboring samples, not at \
             midpoints; on the CPU it trains as documented",
        );
        let (scene, pixels, opts) = (self.scene, self.pixels, self.opts);
        let on_device = on_gpu::DeviceScene::new(pixels, scene, &opts.paper, opts.seed);
        let (records, unit_mm) = (&mut self.records, pixels.bounds.unit_mm);
        let mut on_report = |report: &nelu3d_field::gpu::TrainingReport, done: usize| {
            let counts = IterationCounts {
                inv_s_per_mm: report.inv_s / unit_mm,
                rays: report.n_rays,
                samples: report.n_samples,
                occupied: report.occupied,
            };
            records.push(TrainingRecord::new(done, &report.losses, counts));
            report.losses.total.is_finite()
        };
        let mut parts = on_gpu::TrainedParts {
            surface: &mut self.surface,
            ambient: &mut self.ambient,
            occupancy: &mut self.occupancy,
        };
        let (done, n_rays) = on_device.train(&gpu, &mut parts, self.n_steps, cx, &mut on_report, &|parts| {
            render_view(parts.surface, pixels, &scene.rays, parts.occupancy, scene.measurements.n()).depth
        })?;
        self.n_rays = n_rays;
        Ok(done)
    }

    /// Trains the iterations from `done` on.
    fn run_on_cpu(&mut self, done: usize, cx: &mut Context<'_>) -> Result<(), Failure> {
        let (scene, seed) = (self.scene, self.opts.seed);
        let colors = Codewords::of(scene);
        let mut batch = RayBatch::default();
        let settings = &self.opts.paper;
        let per_ray = importance::per_ray(settings.samples, settings.ray_samples);
        for step in done..self.n_steps {
            cx.stop_if_cancelled()?;
            config::update_occupancy(&mut self.occupancy, &self.surface, step as u64, seed);
            let (m, rays) = (&scene.measurements, &scene.rays);
            let (grid, surface) = (&self.occupancy, &self.surface);
            batch.draw(self.pixels, m, rays, &colors, grid, surface, self.n_rays, per_ray, seed, step as u64);
            let anneal = config::anneal(step, self.n_steps);
            let losses = batch.step(&mut self.surface, &mut self.ambient, anneal);
            let n_samples = batch.n_samples();
            if step % 100 == 0 || step + 1 == self.n_steps {
                let counts = IterationCounts {
                    inv_s_per_mm: self.surface.inv_s() / self.pixels.bounds.unit_mm,
                    rays: self.n_rays,
                    samples: n_samples,
                    occupied: self.occupancy.occupied_fraction(),
                };
                self.records.push(TrainingRecord::new(step + 1, &losses, counts));
                tracing::info!(?losses, record = ?self.records.last(), "training");
                if !losses.total.is_finite() {
                    return Err(diverged(step + 1));
                }
            }
            self.n_rays = config::next_ray_count(self.n_rays, n_samples, self.opts.paper.samples);
            cx.progress.tick(step + 1, self.n_steps);
            if is_observed_after(step + 1, self.n_steps) {
                cx.observe(Stage::Refine, step + 1, || self.render_view().depth);
            }
        }
        Ok(())
    }

    /// Renders the present surface from the camera.
    pub(super) fn render_view(&self) -> RenderedView {
        let (rays, n) = (&self.scene.rays, self.scene.measurements.n());
        render_view(&self.surface, self.pixels, rays, &self.occupancy, n)
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
