//! The training of recipe `paper` on a GPU, where the scene stays: see [`nelu3d_field::gpu::SurfaceTraining`].

use nelu3d_field::NeuralSurface;
use nelu3d_field::device::DeviceError;
use nelu3d_field::gpu::{AmbientUse, Gpu, RayScene, ScenePixel, SurfaceTraining, TrainingReport};
use nelu3d_field::lattice::{Lattice, ProjectiveFrame};
use nelu3d_field::occupancy::OccupancyGrid;
use std::sync::Arc;

use super::ambient::{Ambient, AmbientField, MIN_WHITE, image_point};
use super::batch::TrainingPixels;
use super::config;
use super::march::step_mm;
use super::options::PaperOptions;
use super::record::{diverged, is_observed_after};
use crate::reconstruct::context::Context;
use crate::reconstruct::error::Failure;
use crate::reconstruct::observer::Stage;
use crate::reconstruct::scene::Scene;

/// Number of iterations after which the state is fetched: as many at most are lost with a device.
const CHECKPOINT: usize = 1000;

/// The parts of a training that a device takes over and gives back.
pub struct TrainedParts<'a> {
    /// The signed distance field.
    pub surface: &'a mut NeuralSurface,
    /// The ambient term.
    pub ambient: &'a mut AmbientField,
    /// The occupancy grid.
    pub occupancy: &'a mut OccupancyGrid,
}

/// What follows a training on a device.
pub trait Follower {
    /// Receives a report and the number of iterations that are done; answers whether the loss is still a number.
    fn report(&mut self, report: &TrainingReport, done: usize) -> bool;

    /// Receives the state after `done` iterations, which the next goes on from with `n_rays` rays; `stopping` when no
    /// more will come because the work is canceled.
    ///
    /// # Errors
    ///
    /// It cannot be kept, which ends the training.
    fn fetched(&mut self, parts: &TrainedParts<'_>, done: usize, n_rays: usize, stopping: bool) -> Result<(), Failure>;

    /// Renders the depth map of what is trained so far, camera z in mm, 0 where there is none.
    fn render_depth(&self, parts: &TrainedParts<'_>) -> Vec<f32>;
}

/// A scene as the device needs it.
pub struct DeviceScene<'a> {
    /// The pixels.
    pub pixels: Vec<ScenePixel>,
    /// Where all rays begin, in the cube's coordinates.
    pub origin: [f32; 3],
    /// Measured codewords, `[pixel][k]`.
    pub measured: Vec<f32>,
    /// White − black, `[pixel][channel]`.
    pub white: Vec<f32>,
    /// Channels of the camera.
    pub n_channels: usize,
    /// The frozen color field.
    pub lattice: Lattice<'a>,
    /// Rows of the affine map from the cube's coordinates (and 1) to those along the axes of `frame`.
    pub affine: [[f32; 4]; 3],
    /// The frame of the color field.
    pub frame: ProjectiveFrame,
    /// The ambient term.
    pub ambient: AmbientUse,
    /// Samples that an iteration should have.
    pub n_samples: usize,
    /// Distance of samples along a ray, mm.
    pub step: f32,
    /// Half of the length of a sample's interval, and of that over which a cell's alpha is computed, in the unit of
    /// the distance field.
    pub half_step: f32,
    /// Iterations over which the cosine of the alphas is annealed; 0 for none.
    pub anneal_steps: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl<'a> DeviceScene<'a> {
    /// Collects what the device needs for a training of `n_steps` iterations.
    pub(super) fn new(
        pixels: &TrainingPixels,
        scene: &'a Scene<'_>,
        settings: &PaperOptions,
        n_steps: usize,
        seed: u64,
    ) -> Self {
        let Scene { field, grid, rays, measurements: m, .. } = scene;
        let bounds = &pixels.bounds;
        let side = bounds.side_mm();
        let (k, n_channels) = (m.k, m.light.len() / m.n());
        let mut out = Vec::with_capacity(pixels.all.len());
        let (mut measured, mut white) = (Vec::new(), Vec::new());
        for (&i, &is_lit) in pixels.all.iter().zip(&pixels.is_lit) {
            let i = i as usize;
            let ray = pixels.march(rays, i, 0.0);
            let [near, far] = bounds.clip(&ray.origin, &ray.dir, ray.range).map(|t| t as f32);
            let dir = (ray.dir / side).map(|d| d as f32).into();
            out.push(ScenePixel { dir, near, place: image_point(m, i), far, mask: f32::from(u8::from(is_lit)) });
            measured.extend(m.p[i * k..(i + 1) * k].iter().map(|p| if is_lit { *p } else { 0.0 }));
            white.extend(m.light[i * n_channels..(i + 1) * n_channels].iter().map(|l| l.max(0.0)));
        }
        // From the cube to the frame: x = center + (q − 1/2) side, y = M (x, 1).
        let frame = &field.frame;
        let corner = bounds.center.coords.map(|c| c - 0.5 * side);
        let affine = frame.affine().map(|row| {
            let offset = row[0] * corner.x + row[1] * corner.y + row[2] * corner.z + row[3];
            [row[0] * side, row[1] * side, row[2] * side, offset].map(|v| v as f32)
        });
        Self {
            pixels: out,
            origin: std::array::from_fn(|a| (0.5 - bounds.center[a] / side) as f32),
            measured,
            white,
            n_channels,
            lattice: grid.lattice(),
            affine,
            frame: frame.projective(),
            ambient: match settings.ambient {
                Ambient::None => AmbientUse::None,
                Ambient::Bounded => AmbientUse::Fraction,
                Ambient::Unbounded => AmbientUse::Intensity { min_white: MIN_WHITE },
            },
            n_samples: settings.samples,
            step: step_mm(bounds) as f32,
            half_step: 0.5 * config::step_units(),
            anneal_steps: settings.start.anneal_steps(n_steps),
            seed,
        }
    }

    /// Trains what is in `parts` from `reached` on, the number of iterations that are done and of the rays of the next.
    /// Returns how far it came: to `n_steps`, or to the last state fetched from a device that failed.
    ///
    /// # Errors
    ///
    /// The training diverged, was canceled, or a state could not be kept.
    pub fn train(
        &self,
        gpu: &Arc<Gpu>,
        parts: &mut TrainedParts<'_>,
        mut reached: (usize, usize),
        n_steps: usize,
        cx: &mut Context<'_>,
        follower: &mut dyn Follower,
    ) -> Result<(usize, usize), Failure> {
        match self.attempt(gpu, parts, &mut reached, n_steps, cx, follower) {
            Ok(Ok(())) => {}
            Ok(Err(failure)) => return Err(failure),
            Err(e) => cx.progress.warn(format!("{e}; training goes on from iteration {} on the CPU", reached.0)),
        }
        Ok(reached)
    }

    /// Trains until the end or until the device fails; `reached` is how far [`Self::train`] came.
    fn attempt(
        &self,
        gpu: &Arc<Gpu>,
        parts: &mut TrainedParts<'_>,
        reached: &mut (usize, usize),
        n_steps: usize,
        cx: &mut Context<'_>,
        follower: &mut dyn Follower,
    ) -> Result<Result<(), Failure>, DeviceError> {
        let scene = RayScene {
            pixels: &self.pixels,
            origin: self.origin,
            step: self.step,
            measured: &self.measured,
            white: &self.white,
            n_channels: self.n_channels,
            lattice: self.lattice,
            affine: self.affine,
            frame: self.frame,
            ambient: self.ambient,
            n_samples: self.n_samples,
            first_step: reached.0,
            first_rays: reached.1,
            max_rays: config::MAX_RAYS,
            half_step: self.half_step,
            anneal_steps: self.anneal_steps,
            seed: self.seed,
        };
        let mut training =
            SurfaceTraining::new(gpu, parts.surface, &parts.ambient.field, parts.occupancy, &scene, n_steps)?;
        while training.done() < n_steps {
            if let Err(canceled) = cx.stop_if_cancelled() {
                if training.done() > reached.0 {
                    let report = training.report()?;
                    self.fetch(&training, &report, parts, reached)?;
                }
                let kept = follower.fetched(parts, reached.0, reached.1, true);
                return Ok(kept.and(Err(canceled)));
            }
            // The records are of the iterations after each hundredth, and of the last.
            let done = training.done();
            let record = done / 100 * 100 + 1 + if done % 100 == 0 { 0 } else { 100 };
            let shown =
                (done + 1..=n_steps).find(|&d| cx.is_observed() && is_observed_after(d, n_steps)).unwrap_or(n_steps);
            let until = record.min(shown).min(n_steps).min((done / CHECKPOINT + 1) * CHECKPOINT);
            let report = training.run(until)?;
            cx.progress.tick(until, n_steps);
            if (until == record || until == n_steps) && !follower.report(&report, until) {
                return Ok(Err(diverged(until)));
            }
            if until == shown || until.is_multiple_of(CHECKPOINT) || until == n_steps {
                self.fetch(&training, &report, parts, reached)?;
                if let Err(failure) = follower.fetched(parts, reached.0, reached.1, false) {
                    return Ok(Err(failure));
                }
                if until == shown {
                    cx.observe(Stage::Refine, until, || follower.render_depth(parts));
                }
            }
        }
        Ok(Ok(()))
    }

    /// Brings back what was trained, whole or not at all, and how far it is.
    fn fetch(
        &self,
        training: &SurfaceTraining,
        report: &TrainingReport,
        parts: &mut TrainedParts<'_>,
        reached: &mut (usize, usize),
    ) -> Result<(), DeviceError> {
        let mut surface = parts.surface.clone();
        let mut ambient = parts.ambient.field.clone();
        let mut occupancy = parts.occupancy.clone();
        training.fetch(&mut surface, &mut ambient, &mut occupancy)?;
        (*parts.surface, parts.ambient.field, *parts.occupancy) = (surface, ambient, occupancy);
        *reached = (training.done(), config::next_ray_count(report.n_rays, report.n_samples, self.n_samples));
        Ok(())
    }
}
