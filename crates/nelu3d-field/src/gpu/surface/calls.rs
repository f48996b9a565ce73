//! The calls of a step, recorded once.

use super::super::Gpu;
use super::super::net::{Back, Net};
use super::super::program::{Binding, Call, Constants, Kernels, folded};
use super::buffers::{Buffers, N_PARTS, control};
use super::scene::{AmbientUse, RayScene};
use crate::device::DeviceError;
use crate::loss::{MASK_CLAMP, MIN_OPACITY};
use crate::occupancy::OccupancyGrid;
use crate::surface::SurfaceConfig;
use crate::volrend::midpoint;
use std::sync::Arc;

const LEVEL: &str = include_str!("../shaders/level.wgsl");
const RANDOM: &str = include_str!("../shaders/random.wgsl");
const ADAM: &str = include_str!("../shaders/adam.wgsl");
/// Sums over one workgroup.
const TOTAL: &str = concat!(include_str!("../shaders/place.wgsl"), include_str!("../shaders/total.wgsl"));

/// The calls of a training.
#[derive(Debug)]
pub(super) struct Calls {
    /// The update of the occupancy grid.
    pub(super) look: Vec<Call>,
    /// Rays, samples, codewords, ambient light.
    pub(super) draw: Vec<Call>,
    /// Losses, gradients, optimizers.
    pub(super) step: Vec<Call>,
    /// The sums of the losses.
    pub(super) record: Vec<Call>,
}

impl Calls {
    /// Records the calls of a training.
    pub(super) fn new(
        gpu: &Arc<Gpu>,
        [net, ambient]: [&Net; 2],
        buffers: &Buffers,
        config: &SurfaceConfig,
        occupancy: &OccupancyGrid,
        scene: &RayScene<'_>,
    ) -> Result<Self, DeviceError> {
        let constants = constants([net, ambient], buffers, occupancy, scene);
        let kernels = Kernels::new(gpu);
        let mut recorder = Recorder { gpu, kernels, net, ambient, buffers, config, occupancy, scene, constants };
        Ok(Self { look: recorder.look()?, draw: recorder.draw()?, step: recorder.step()?, record: recorder.record()? })
    }
}

/// Returns the constants that complete every kernel of a training.
fn constants([net, ambient]: [&Net; 2], buffers: &Buffers, occupancy: &OccupancyGrid, scene: &RayScene) -> Constants {
    net.constants(&buffers.shared())
        .count("STEP_AT", control::STEP_AT)
        .count("RAYS_AT", control::RAYS_AT)
        .count("N_AT_SAMPLES", control::N_AT)
        .count("PICKED_AT", control::PICKED_AT)
        .count("BATCH_AT", control::BATCH_AT)
        .count("BEGIN_AT", control::BEGIN_AT)
        .count("SAVED_AT", control::SAVED_AT)
        .count("SEED", (scene.seed as u32 ^ (scene.seed >> 32) as u32) as usize)
        .count("K", scene.lattice.k)
        .count("N_CHANNELS", scene.n_channels)
        .count("RAY_CAPACITY", ambient.capacity)
        .count("CELLS", occupancy.config.resolution)
}

/// A training whose calls are being recorded.
struct Recorder<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    net: &'a Net,
    ambient: &'a Net,
    buffers: &'a Buffers,
    config: &'a SurfaceConfig,
    occupancy: &'a OccupancyGrid,
    scene: &'a RayScene<'a>,
    constants: Constants,
}

impl Recorder<'_> {
    fn per_sample(&self) -> [usize; 3] {
        [self.net.capacity / 64, 1, 1]
    }

    fn per_ray(&self) -> [usize; 3] {
        [self.ambient.capacity / 64, 1, 1]
    }

    /// Updates the occupancy grid: picks cells, evaluates the distance in them batch by batch, marks the occupied ones.
    fn look(&mut self) -> Result<Vec<Call>, DeviceError> {
        let mut calls = Vec::new();
        let (b, n_cells) = (self.buffers, self.occupancy.cells.len());
        if n_cells == 0 {
            return Ok(calls);
        }
        let config = &self.occupancy.config;
        let constants = self
            .constants
            .clone()
            .count("N_CELLS", n_cells)
            .count("WARMUP", config.n_warmup_steps as usize)
            .value("HALF_STEP", self.scene.half_step.into())
            .value("DECAY", config.decay.into())
            .value("THRESHOLD", config.threshold.into());
        calls.push(self.next_cells("cells_restart", "RESTART")?);
        let source = [RANDOM, include_str!("../shaders/cells_pick.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&b.control, &b.cells, &b.occupied, &b.picked];
        calls.push(self.kernels.run("cells_pick", &source, &constants, folded(n_cells, 256), bindings)?);
        let mut batch = vec![self.next_cells("cells_next", "NEXT")?];
        let per_sample = self.per_sample();
        let source = [RANDOM, include_str!("../shaders/cells_points.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&b.control, &b.picked, &self.net.points];
        batch.push(self.kernels.run("cells_points", &source, &constants, per_sample, bindings)?);
        batch.extend(self.net.forward(&mut self.kernels, &b.shared())?);
        let source = include_str!("../shaders/cells_write.wgsl");
        let bindings: &[&dyn Binding] = &[&b.control, &b.picked, &self.net.out, &b.sharpness, &b.values];
        batch.push(self.kernels.run("cells_write", source, &constants, per_sample, bindings)?);
        for _ in 0..n_cells.div_ceil(self.net.capacity) {
            calls.extend(batch.iter().cloned());
        }
        calls.push(self.next_cells("cells_done", "DONE")?);
        let source = [TOTAL, include_str!("../shaders/cells_mean.wgsl")].concat();
        let constants = constants.count("N_PARTS", N_PARTS);
        let of_parts = constants.clone().flag("PARTS", true);
        let bindings: &[&dyn Binding] = &[&b.cells, &b.values, &b.parts];
        calls.push(self.kernels.run("cells_parts", &source, &of_parts, [N_PARTS, 1, 1], bindings)?);
        let bindings: &[&dyn Binding] = &[&b.parts, &b.threshold];
        calls.push(self.kernels.run("cells_mean", &source, &constants, [1; 3], bindings)?);
        let source = include_str!("../shaders/cells_mark.wgsl");
        let groups = [config.resolution.pow(3).div_ceil(32 * 64), 1, 1];
        let bindings: &[&dyn Binding] = &[&b.values, &b.threshold, &b.occupied];
        calls.push(self.kernels.run("cells_mark", source, &constants, groups, bindings)?);
        Ok(calls)
    }

    /// Begins, goes on with, or ends the batches of picked cells.
    fn next_cells(&mut self, label: &'static str, flag: &'static str) -> Result<Call, DeviceError> {
        let constants = self.constants.clone().flag(flag, true);
        let source = include_str!("../shaders/cells_next.wgsl");
        self.kernels.run(label, source, &constants, [1; 3], &[&self.buffers.control])
    }

    /// Draws rays and their samples; evaluates the color field and the ambient light there.
    fn draw(&mut self) -> Result<Vec<Call>, DeviceError> {
        let (b, scene) = (self.buffers, self.scene);
        let constants = self
            .constants
            .clone()
            .count("FIRST_STEP", scene.first_step)
            .count("TARGET", scene.n_samples)
            .count("MAX_RAYS", scene.max_rays)
            .count("MAX_SAMPLES", self.net.capacity)
            .count("N_PIXELS", scene.pixels.len())
            .value("STEP_T", scene.step.into())
            .value("ORIGIN_X", scene.origin[0].into())
            .value("ORIGIN_Y", scene.origin[1].into())
            .value("ORIGIN_Z", scene.origin[2].into())
            .count("CELLS_A", scene.lattice.cells[0])
            .count("CELLS_B", scene.lattice.cells[1])
            .count("CELLS_W", scene.lattice.cells[2]);
        let per_sample = self.per_sample();
        let source = include_str!("../shaders/begin.wgsl");
        let bindings: &[&dyn Binding] = &[&b.control, &b.schedule, &b.rates];
        let mut calls = vec![self.kernels.run("begin", source, &constants, [1; 3], bindings)?];
        let source = [RANDOM, include_str!("../shaders/draw.wgsl")].concat();
        let each_ray = [scene.max_rays, 1, 1];
        let bindings: &[&dyn Binding] = &[&b.control, &b.pixels, &b.occupied, &b.rays];
        calls.push(self.kernels.run("draw", &source, &constants, each_ray, bindings)?);
        let places = include_str!("../shaders/draw_places.wgsl");
        calls.push(self.kernels.run("draw_places", places, &constants, [1; 3], &[&b.control, &b.rays])?);
        let bindings: &[&dyn Binding] =
            &[&b.control, &b.pixels, &b.occupied, &b.rays, &self.net.points, &self.ambient.points];
        let samples = constants.clone().flag("SAMPLES", true);
        calls.push(self.kernels.run("draw_samples", &source, &samples, each_ray, bindings)?);
        let source = include_str!("../shaders/lattice.wgsl");
        let bindings: &[&dyn Binding] = &[&b.control, &self.net.points, &b.nodes, &b.frame, &b.colors];
        calls.push(self.kernels.run("lattice", source, &constants, per_sample, bindings)?);
        if scene.ambient != AmbientUse::None {
            calls.extend(self.ambient.forward(&mut self.kernels, &b.shared_ambient())?);
        }
        Ok(calls)
    }

    /// Computes losses and gradients and takes the optimizers' steps.
    fn step(&mut self) -> Result<Vec<Call>, DeviceError> {
        let b = self.buffers;
        let (shared, shared_ambient) = (b.shared(), b.shared_ambient());
        let mut calls = self.net.forward(&mut self.kernels, &shared)?;
        calls.extend(self.net.back_to_inputs(&mut self.kernels, &shared, true)?);
        calls.push(self.slopes()?);
        calls.push(self.render()?);
        let (levels, hashed, x, n_levels) = self.net.encoding();
        let source = [LEVEL, include_str!("../shaders/tangents.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&b.control, levels, hashed, &self.net.points, x, &b.s, &b.u];
        let groups = [self.net.capacity / 64, n_levels, 1];
        calls.push(self.kernels.run("tangents_x", &source, &self.constants, groups, bindings)?);
        calls.extend(self.net.tangents(&mut self.kernels, &shared, &b.s)?);
        let back = Back::Distance { s: &b.s, u: &b.u };
        calls.extend(self.net.descend(self.gpu, &mut self.kernels, &shared, back)?);
        if self.scene.ambient != AmbientUse::None {
            calls.extend(self.ambient.back_to_inputs(&mut self.kernels, &shared_ambient, false)?);
            calls.extend(self.ambient.descend(self.gpu, &mut self.kernels, &shared_ambient, Back::Outputs)?);
        }
        calls.push(self.sharpen()?);
        Ok(calls)
    }

    /// Computes the gradients of the samples' distances.
    fn slopes(&mut self) -> Result<Call, DeviceError> {
        let b = self.buffers;
        let (levels, hashed, _, n_levels) = self.net.encoding();
        let constants = self.extent().count("N_LEVELS", n_levels);
        let source = [LEVEL, include_str!("../shaders/slopes.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&b.control, levels, hashed, &self.net.points, self.net.d_x(), &b.u];
        self.kernels.run("slopes", &source, &constants, [self.net.capacity / 64, 1, 1], bindings)
    }

    /// Returns the constants with the lengths of the cube's axes.
    fn extent(&self) -> Constants {
        let [x, y, z] = self.config.extent.map(f64::from);
        self.constants.clone().value("EXTENT_X", x).value("EXTENT_Y", y).value("EXTENT_Z", z)
    }

    /// Composites the rays, computes their losses, and sends the gradients back to distances, their gradients, and
    /// ambient light.
    fn render(&mut self) -> Result<Call, DeviceError> {
        let (b, settings, ambient) = (self.buffers, &self.config.loss, self.scene.ambient);
        let min_white = match ambient {
            AmbientUse::Intensity { min_white } => min_white,
            _ => 0.0,
        };
        let constants = self
            .extent()
            .value("HALF_STEP", self.scene.half_step.into())
            .value("EPSILON_ALPHA", midpoint::EPSILON)
            .value("LEAST_PASSED", midpoint::LEAST_PASSED)
            .value("ANNEAL_STEPS", self.scene.anneal_steps as f64)
            .flag("ANNEALED", self.scene.anneal_steps > 0)
            .value("EIKONAL_WEIGHT", settings.eikonal_weight)
            .value("L1", settings.norms.l1)
            .value("L2", settings.norms.l2)
            .value("ALPHA", settings.lookup_loss_weight)
            .value("MASK_WEIGHT", settings.mask_weight)
            .value("SPARSITY_WEIGHT", settings.sparsity_weight)
            .value("MASK_CLAMP", MASK_CLAMP)
            .value("MIN_OPACITY", MIN_OPACITY)
            .value("MIN_WHITE", min_white.into())
            .flag("BOUNDED", ambient == AmbientUse::Fraction)
            .flag("UNBOUNDED", matches!(ambient, AmbientUse::Intensity { .. }))
            .flag("CLAMPED", settings.clamped_mask);
        let mut bindings: Vec<&dyn Binding> =
            vec![&b.control, &b.pixels, &b.rays, &self.net.out, &b.colors, &b.measured, &b.sharpness];
        let more: [&dyn Binding; 4] = [self.ambient.d_out(), &b.u, &b.s, &b.of_ray];
        bindings.extend(more);
        if ambient != AmbientUse::None {
            bindings.push(&self.ambient.out);
        }
        let groups = self.per_ray();
        self.kernels.run("render", include_str!("../shaders/render.wgsl"), &constants, groups, &bindings)
    }

    /// Takes the step of the sharpness.
    fn sharpen(&mut self) -> Result<Call, DeviceError> {
        let (b, adam) = (self.buffers, &self.config.field.training.adam);
        let constants = self
            .constants
            .clone()
            .value("BETA1", adam.beta1)
            .value("BETA2", adam.beta2)
            .value("EPSILON", adam.epsilon)
            .value("LEARNING_RATE", self.config.sharpness_learning_rate);
        let source = [ADAM, TOTAL, include_str!("../shaders/sharpness.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&b.control, &b.rates, &b.of_ray, &b.sharpness];
        self.kernels.run("sharpness", &source, &constants, [1; 3], bindings)
    }

    /// Sums the losses of the step.
    fn record(&mut self) -> Result<Vec<Call>, DeviceError> {
        let b = self.buffers;
        let source = [TOTAL, include_str!("../shaders/losses.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&b.control, &b.of_ray, &b.u, &self.net.out, &b.losses];
        Ok(vec![self.kernels.run("losses", &source, &self.constants, [1; 3], bindings)?])
    }
}
