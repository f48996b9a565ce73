//! The ceilings of a device, and how close a training step comes to them.

use super::timing::{Demand, ceilings};
use super::{AmbientUse, Gpu, RayScene, ScenePixel, SurfaceTraining};
use crate::adam::Schedule;
use crate::device::DeviceError;
use crate::encoding::hash_grid::HashGridConfig;
use crate::field::{HashField, HashFieldConfig, TrainConfig};
use crate::lattice::{Lattice, ProjectiveFrame};
use crate::mlp::Activation;
use crate::occupancy::{OccupancyConfig, OccupancyGrid};
use crate::surface::{NeuralSurface, SurfaceConfig, SurfaceLoss};
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

/// A phase, measured.
#[derive(Clone, Debug, Serialize)]
pub struct PhaseResult {
    /// Name of the phase.
    pub name: &'static str,
    /// Seconds.
    pub secs: f64,
    /// Floating-point operations.
    pub flops: f64,
    /// Bytes to and from its memory, each counted once per access.
    pub bytes: f64,
    /// The least possible time, by the ceiling that is nearer, over the time taken.
    pub share_of_ceiling: f64,
    /// `arithmetic` or `memory`.
    pub bound: &'static str,
}

/// A device and a step of recipe `paper` on it.
#[derive(Clone, Debug, Serialize)]
pub struct GpuReport {
    /// The device.
    pub device: String,
    /// Fused multiply-adds in single precision, two operations each.
    pub flops_per_sec: f64,
    /// Reading and writing its memory in order.
    pub bytes_per_sec: f64,
    /// Rays of the step.
    pub n_rays: usize,
    /// Samples of the step.
    pub n_samples: usize,
    /// Seconds of a whole step, many in a row.
    pub step_secs: f64,
    /// Memory that the training holds, bytes.
    pub memory_bytes: u64,
    /// The step's phases, each many times in a row.
    pub phases: Vec<PhaseResult>,
}

impl GpuReport {
    /// Measures a step of the published size: 2^19 entries, 2 × 64 units, about `n_samples` samples; `budget` seconds
    /// for each phase.
    ///
    /// # Errors
    ///
    /// The device failed, or the step does not fit.
    pub fn measure(gpu: &Arc<Gpu>, n_samples: usize, budget: f64) -> Result<Self, DeviceError> {
        let [flops_per_sec, bytes_per_sec] = ceilings(gpu, budget)?;
        let (surface, ambient) = published_networks();
        // A shell around the middle, as a surface leaves it; rays that cross it take 32 samples.
        let occupancy = OccupancyGrid::new(OccupancyConfig::default(), |p| (p[2] - 0.5).abs() < 1.0 / 64.0);
        let n_rays = (n_samples / 32).max(64);
        let pixels = fan_of_pixels(64);
        let cells = [128, 128, 4];
        let nodes: Vec<f32> = (0..131 * 131 * 7 * 3).map(|i| (i * 7919 % 1009) as f32 / 1009.0).collect();
        let scene = RayScene {
            pixels: &pixels,
            origin: [0.5, 0.5, -1.0],
            step: 1.0 / 1024.0,
            measured: &vec![0.4; pixels.len() * 3],
            white: &vec![0.8; pixels.len()],
            n_channels: 1,
            lattice: Lattice { nodes: &nodes, cells, k: 3 },
            affine: RayScene::CUBE,
            frame: ProjectiveFrame::UNIT,
            ambient: AmbientUse::Fraction,
            n_samples,
            first_step: 0,
            first_rays: n_rays,
            max_rays: n_rays,
            half_step: 0.0025,
            anneal_steps: 0,
            seed: 1,
        };
        let before = gpu.memory();
        let mut training = SurfaceTraining::new(gpu, &surface, &ambient, &occupancy, &scene, 100_000)?;
        let memory_bytes = gpu.memory() - before;
        let report = training.run(1)?;
        let (n_rays, n_samples) = (report.n_rays, report.n_samples);
        let mut phases = Vec::new();
        let step_secs = training.measure(budget, n_samples, |name, secs, demand: Demand| {
            let (arithmetic, memory) = (demand.flops / flops_per_sec, demand.bytes / bytes_per_sec);
            phases.push(PhaseResult {
                name,
                secs,
                flops: demand.flops,
                bytes: demand.bytes,
                share_of_ceiling: arithmetic.max(memory) / secs,
                bound: if arithmetic > memory { "arithmetic" } else { "memory" },
            });
        })?;
        let device = gpu.name().to_owned();
        Ok(Self { device, flops_per_sec, bytes_per_sec, n_rays, n_samples, step_secs, memory_bytes, phases })
    }
}

/// Makes a surface and an ambient network of the published size: 2^19 entries, 2 × 64 units.
fn published_networks() -> (NeuralSurface, HashField<2>) {
    let encoding = HashGridConfig {
        n_levels: 16,
        n_features_per_level: 2,
        log2_hashmap_size: 19,
        base_resolution: [16; 3],
        finest_resolution: [4096; 3],
    };
    let schedule = Schedule { n_steps: 100_000, ..Schedule::default() };
    let training = TrainConfig { weight_normalization: true, schedule, ..TrainConfig::default() };
    let field = HashFieldConfig {
        encoding,
        n_outputs: 1,
        width: 64,
        n_hidden_layers: 2,
        output_activation: Activation::Linear,
        append_position: true,
        training: training.clone(),
    };
    let loss = SurfaceLoss::default();
    let config = SurfaceConfig { field, extent: [3.0; 3], sharpness: 0.3, sharpness_learning_rate: 0.0, loss };
    let surface = NeuralSurface::new(config, 1).expect("the published configuration is valid");
    let mut image = HashFieldConfig::<2>::small(1);
    image.output_activation = Activation::Sigmoid;
    image.training = TrainConfig { weight_normalization: false, ..training };
    (surface, HashField::new(image, 1).expect("a valid configuration"))
}

/// Makes `side × side` pixels whose rays fan out along z.
fn fan_of_pixels(side: usize) -> Vec<ScenePixel> {
    let pixel = |i: usize| {
        let at = |v: usize| (v as f32 + 0.5) / side as f32;
        let place = [at(i % side), at(i / side)];
        let dir = [0.4 * (place[0] - 0.5), 0.4 * (place[1] - 0.5), 1.0];
        ScenePixel { dir, near: 1.0, place, far: 2.0, mask: 1.0 }
    };
    (0..side * side).map(pixel).collect()
}

impl fmt::Display for GpuReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.device)?;
        writeln!(f, "{:.3} TFLOP/s, {:.1} GB/s", self.flops_per_sec / 1e12, self.bytes_per_sec / 1e9)?;
        writeln!(
            f,
            "a step of {} rays, {} samples: {:.3} ms, {:.1} million samples/s, {} MB\n",
            self.n_rays,
            self.n_samples,
            1e3 * self.step_secs,
            1e-6 * self.n_samples as f64 / self.step_secs,
            self.memory_bytes / 1_000_000
        )?;
        writeln!(f, "phase                          ms   GFLOP/s     GB/s  of ceiling")?;
        for p in &self.phases {
            writeln!(
                f,
                "{:<24} {:>8.3}  {:>8.1} {:>8.1}  {:>5.1} % ({})",
                p.name,
                1e3 * p.secs,
                1e-9 * p.flops / p.secs,
                1e-9 * p.bytes / p.secs,
                100.0 * p.share_of_ceiling,
                p.bound
            )?;
        }
        Ok(())
    }
}
