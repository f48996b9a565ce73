//! The training of recipe `paper` on a GPU, where the scene stays: see [`nelu3d_field::gpu::SurfaceTraining`].

use nelu3d_field::NeuralSurface;
use nelu3d_field::device::DeviceError;
use nelu3d_field::gpu::{AmbientUse, Gpu, RayScene, ScenePixel, SurfaceTraining, TrainingReport};
use nelu3d_field::lattice::{Lattice, ProjectiveFrame};
use nelu3d_field::occupancy::OccupancyGrid;
use std::sync::Arc;

use super::ambient::{Ambient, AmbientField, MIN_WHITE, image_point};
use super::batch::TrainingPixels;
use super::bounds::SIDE;
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
pub(super) struct TrainedParts<'a> {
    /// The signed distance field.
    pub(super) surface: &'a mut NeuralSurface,
    /// The ambient term.
    pub(super) ambient: &'a mut AmbientField,
    /// The occupancy grid.
    pub(super) occupancy: &'a mut OccupancyGrid,
}

/// Receives a report and the number of iterations that are done; answers whether the loss is still a number.
pub(super) type OnReport<'a> = dyn FnMut(&TrainingReport, usize) -> bool + 'a;

/// Renders the depth map of what is trained so far.
pub(super) type RenderDepth<'a> = dyn Fn(&TrainedParts<'_>) -> Vec<f32> + 'a;

/// A scene as the device needs it.
pub(super) struct DeviceScene<'a> {
    pixels: Vec<ScenePixel>,
    origin: [f32; 3],
    measured: Vec<f32>,
    white: Vec<f32>,
    n_channels: usize,
    lattice: Lattice<'a>,
    affine: [[f32; 4]; 3],
    frame: ProjectiveFrame,
    ambient: AmbientUse,
    n_samples: usize,
    step: f32,
    half_step: f32,
    seed: u64,
}

impl<'a> DeviceScene<'a> {
    /// Collects what the device needs.
    pub(super) fn new(pixels: &TrainingPixels, scene: &'a Scene<'_>, settings: &PaperOptions, seed: u64) -> Self {
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
            measured.extend_from_slice(&m.p[i * k..(i + 1) * k]);
            white.extend_from_slice(&m.light[i * n_channels..(i + 1) * n_channels]);
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
            half_step: (0.5 * SIDE * 3f64.sqrt() / config::STEPS_PER_DIAGONAL) as f32,
            seed,
        }
    }

    /// Trains what is in `parts`, and returns the number of iterations that are done and of the rays of the last: all,
    /// or those up to the last checkpoint of a device that failed.
    pub(super) fn train(
        &self,
        gpu: &Arc<Gpu>,
        parts: &mut TrainedParts<'_>,
        n_steps: usize,
        cx: &mut Context<'_>,
        on_report: &mut OnReport<'_>,
        render_depth: &RenderDepth<'_>,
    ) -> Result<(usize, usize), Failure> {
        let mut saved = (0, config::FIRST_RAYS);
        match self.attempt(gpu, parts, n_steps, cx, on_report, render_depth, &mut saved) {
            Ok(Ok(())) => {}
            Ok(Err(failure)) => return Err(failure),
            Err(e) => cx.progress.warn(format!("{e}; training goes on from iteration {} on the CPU", saved.0)),
        }
        Ok(saved)
    }

    /// Trains until the end or until the device fails; `saved` is how far [`Self::train`] came.
    fn attempt(
        &self,
        gpu: &Arc<Gpu>,
        parts: &mut TrainedParts<'_>,
        n_steps: usize,
        cx: &mut Context<'_>,
        on_report: &mut OnReport<'_>,
        render_depth: &RenderDepth<'_>,
        saved: &mut (usize, usize),
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
            first_rays: config::FIRST_RAYS,
            max_rays: config::MAX_RAYS,
            half_step: self.half_step,
            seed: self.seed,
        };
        let mut training =
            SurfaceTraining::new(gpu, parts.surface, &parts.ambient.field, parts.occupancy, &scene, n_steps)?;
        while training.done() < n_steps {
            if let Err(cancelled) = cx.stop_if_cancelled() {
                return Ok(Err(cancelled));
            }
            // The records are of the iterations after each hundredth, and of the last.
            let done = training.done();
            let record = done / 100 * 100 + 1 + if done % 100 == 0 { 0 } else { 100 };
            let shown =
                (done + 1..=n_steps).find(|&d| cx.is_observed() && is_observed_after(d, n_steps)).unwrap_or(n_steps);
            let until = record.min(shown).min(n_steps).min((done / CHECKPOINT + 1) * CHECKPOINT);
            let report = training.run(until)?;
            cx.progress.tick(until, n_steps);
            if (until == record || until == n_steps) && !on_report(&report, until) {
                return Ok(Err(diverged(until)));
            }
            if until == shown || until.is_multiple_of(CHECKPOINT) || until == n_steps {
                // Whole or not at all.
                let mut surface = parts.surface.clone();
                let mut ambient = parts.ambient.field.clone();
                let mut occupancy = parts.occupancy.clone();
                training.fetch(&mut surface, &mut ambient, &mut occupancy)?;
                (*parts.surface, parts.ambient.field, *parts.occupancy) = (surface, ambient, occupancy);
                *saved = (until, report.n_rays);
                if until == shown {
                    cx.observe(Stage::Refine, until, || render_depth(parts));
                }
            }
        }
        Ok(Ok(()))
    }
}

#[cfg(test)]
mod tests {
    use super::super::start::Start;
    use super::*;
    use crate::progress::Progress;
    use crate::reconstruct::observer::Observer;
    use nelu3d_field::device::Choice;
    use nelu3d_field::encoding::hash_grid::HashGridConfig;
    use nelu3d_field::occupancy::OccupancyConfig;

    /// The last iteration that was observed.
    struct LastIteration(usize);

    impl Observer for LastIteration {
        fn surface(&mut self, _: Stage, iteration: usize, _: &[f32]) {
            self.0 = iteration;
        }
    }

    /// A device that is lost during training leaves the state of the last checkpoint.
    #[test]
    fn a_lost_gpu_hands_over_to_the_cpu() {
        let Ok(gpu) = Gpu::open_anew(Choice::Gpu) else {
            assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "no GPU, and NELU3D_REQUIRE_GPU is set");
            eprintln!("SKIPPED: training on a GPU: no GPU and no software driver");
            return;
        };
        let mut surface_config = config::surface_config(Default::default(), 300);
        config::hasten(&mut surface_config, 300);
        surface_config.field.encoding = HashGridConfig {
            n_levels: 3,
            log2_hashmap_size: 10,
            finest_resolution: [40; 3],
            ..surface_config.field.encoding
        };
        surface_config.field.width = 8;
        let mut surface = Start::Plane.surface(surface_config, 1);
        let before = surface.field().params().to_vec();
        let mut ambient = AmbientField::new(Ambient::Bounded, 1, 300, 1);
        let mut occupancy =
            OccupancyGrid::new(OccupancyConfig { resolution: 8, ..config::occupancy_config(300) }, |_| true);
        let nodes = vec![0.5; 4 * 4 * 4 * 2];
        let pixel = ScenePixel { dir: [0.0, 0.0, 1.0], near: 1.0, place: [0.5; 2], far: 2.0, mask: 1.0 };
        let scene = DeviceScene {
            pixels: vec![pixel; 4],
            origin: [0.5, 0.5, -1.0],
            measured: vec![0.6; 8],
            white: vec![0.9; 4],
            n_channels: 1,
            lattice: Lattice { nodes: &nodes, cells: [1; 3], k: 2 },
            affine: RayScene::CUBE,
            frame: ProjectiveFrame::UNIT,
            ambient: AmbientUse::Fraction,
            n_samples: 512,
            step: 0.05,
            half_step: 0.01,
            seed: 1,
        };
        let mut parts = TrainedParts { surface: &mut surface, ambient: &mut ambient, occupancy: &mut occupancy };
        let plug = gpu.clone();
        let mut reports = Vec::new();
        let mut on_report = |report: &TrainingReport, done: usize| {
            reports.push(done);
            if done > 1 {
                plug.destroy();
            }
            report.losses.total.is_finite()
        };
        let (progress, mut observer) = (Progress::none(), LastIteration(0));
        let mut cx = Context::new(&progress, Choice::Cpu).unwrap().with_observer(Some(&mut observer));
        let (done, n_rays) = scene.train(&gpu, &mut parts, 300, &mut cx, &mut on_report, &|_| Vec::new()).unwrap();
        drop(cx);
        // Observed after 100 iterations, lost after 101.
        assert_eq!((reports.as_slice(), observer.0, done), ([1, 101].as_slice(), 100, 100));
        assert!(n_rays >= 16);
        assert_eq!(surface.field().n_steps(), 100);
        assert!(surface.field().params() != before && surface.field().params().iter().all(|p| p.is_finite()));
    }
}
