//! Training of a [`NeuralSurface`] on the device: rays, samples, codewords, ambient light, compositing, all losses, both networks,
//! the occupancy grid. Nothing goes over the bus from step to step.

use super::Gpu;
use super::bench::{Demand, seconds};
use super::net::{Back, Net, Shared, schedule};
use super::program::{Binding, Buffer, Call, Kernels, folded};
use crate::adam::MomentBuffers;
use crate::device::DeviceError;
use crate::field::HashField;
use crate::loss::{MASK_CLAMP, MIN_OPACITY};
use crate::occupancy::OccupancyGrid;
use crate::surface::{NeuralSurface, SurfaceLosses};
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

const LEVEL: &str = include_str!("shaders/level.wgsl");
const RANDOM: &str = include_str!("shaders/random.wgsl");
const ADAM: &str = include_str!("shaders/adam.wgsl");
/// Of one workgroup.
const TOTAL: &str = concat!(include_str!("shaders/place.wgsl"), include_str!("shaders/total.wgsl"));

/// Steps after which the device is waited for.
const STEPS_AHEAD: usize = 8;

/// Where the numbers are that change from step to step.
const N_AT: usize = 0;
const STEP_AT: usize = 1;
const RAYS_AT: usize = 2;
const PICKED_AT: usize = 3;
const BATCH_AT: usize = 4;
const BEGIN_AT: usize = 5;
const SAVED_AT: usize = 6;
const N_CONTROL: usize = 8;
/// And where the rates of the two nets.
const SURFACE_RATES: usize = 0;
const AMBIENT_RATES: usize = 4;

/// A pixel that rays are drawn from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ScenePixel {
    /// Direction of its ray, in the cube's units per unit of t.
    pub dir: [f32; 3],
    /// Where along it the cube and the field begin.
    pub near: f32,
    /// Its place in the unit square, for the ambient term.
    pub place: [f32; 2],
    /// Where they end.
    pub far: f32,
    /// M, 0 or 1.
    pub mask: f32,
}

/// A frozen color field: a uniform tricubic B-spline over a projective frame of the cube.
#[derive(Clone, Copy, Debug)]
pub struct Lattice<'a> {
    /// Nodes `[b][a][w][k]`, three more along each axis than cells.
    pub nodes: &'a [f32],
    /// Cells along a, b, w.
    pub cells: [usize; 3],
    /// Channels.
    pub k: usize,
    /// Rows of the affine map y = M (cube point, 1).
    pub affine: [[f32; 4]; 3],
    /// Unit coordinates are (y / (1 + kappa y_z) − lo) · scale.
    pub kappa: f32,
    /// See `kappa`.
    pub lo: [f32; 3],
    /// See `kappa`.
    pub scale: [f32; 3],
}

/// What the ambient network's output is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AmbientUse {
    /// Nothing.
    None,
    /// The share A.
    Share,
    /// I_ambient; the share is that divided by I_white, or by this if it is less.
    Intensity {
        /// Least I_white.
        min_white: f32,
    },
}

/// What a surface is trained on.
#[derive(Clone, Copy, Debug)]
pub struct RayScene<'a> {
    /// The pixels.
    pub pixels: &'a [ScenePixel],
    /// Where all rays begin, in the cube's coordinates.
    pub origin: [f32; 3],
    /// Distance of samples along a ray.
    pub step: f32,
    /// Measured codewords, `[pixel][k]`.
    pub measured: &'a [f32],
    /// I_white, `[pixel][channel]`.
    pub white: &'a [f32],
    /// Channels of the camera; pattern j is seen by channel j mod that.
    pub n_channels: usize,
    /// c.
    pub lattice: Lattice<'a>,
    /// The ambient term.
    pub ambient: AmbientUse,
    /// Samples that a step should have.
    pub n_samples: usize,
    /// Rays of the first step.
    pub first_rays: usize,
    /// Most rays of a step.
    pub max_rays: usize,
    /// Half a step, in the unit of the distance: what a cell's alpha is seen over.
    pub half_step: f32,
    /// Seed of the draws.
    pub seed: u64,
}

/// How a training is doing.
#[derive(Clone, Copy, Debug)]
pub struct TrainingReport {
    /// Losses of the last step.
    pub losses: SurfaceLosses,
    /// Its rays.
    pub n_rays: usize,
    /// Its samples.
    pub n_samples: usize,
    /// inv_s after it.
    pub inv_s: f64,
    /// Share of the cells that are occupied.
    pub occupied: f64,
}

/// A training under way. See the module.
#[derive(Debug)]
pub struct SurfaceTraining {
    gpu: Arc<Gpu>,
    net: Net,
    ambient: Net,
    /// Steps done before this training, of the two fields.
    before: [u64; 2],
    done: usize,
    n_steps: usize,
    weights: [f64; 3],
    every: u64,
    control: Buffer<u32>,
    sharpness: Buffer,
    losses: Buffer<[f32; 4]>,
    values: Buffer,
    occupied: Buffer<u32>,
    n_cells: usize,
    // Tests put a batch of their own here.
    #[cfg_attr(not(test), allow(dead_code))]
    rays: Buffer<[u32; 4]>,
    colors: Buffer,
    look: Vec<Call>,
    draw: Vec<Call>,
    step: Vec<Call>,
    record: Vec<Call>,
}

impl SurfaceTraining {
    /// Puts everything on the device, for at most `n_steps` steps.
    ///
    /// # Errors
    ///
    /// It does not fit, or the device failed.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn new(
        gpu: &Arc<Gpu>,
        surface: &NeuralSurface,
        ambient: &HashField<2>,
        occupancy: &OccupancyGrid,
        scene: &RayScene<'_>,
        n_steps: usize,
    ) -> Result<Self, DeviceError> {
        let RayScene { lattice, n_channels, .. } = *scene;
        let k = lattice.k;
        let n_pixels = scene.pixels.len();
        assert!(n_pixels > 0 && scene.measured.len() == n_pixels * k && scene.white.len() == n_pixels * n_channels);
        assert!(ambient.n_outputs() == n_channels);
        assert_eq!(lattice.nodes.len(), lattice.cells.iter().map(|c| c + 3).product::<usize>() * k);
        let (config, settings) = (&surface.config, &surface.config.loss);

        // A quarter more than wanted: how many there will be is known when they are drawn.
        let net = Net::new(gpu, &surface.field, scene.n_samples + scene.n_samples / 4, true)?;
        let ambient_net = Net::new(gpu, ambient, scene.max_rays, true)?;
        let (n, n_rays) = (net.capacity, ambient_net.capacity);
        let control = gpu.upload("control", &{
            let mut values = [0u32; N_CONTROL];
            values[RAYS_AT] = scene.first_rays as u32;
            values
        })?;
        let rates = gpu.zeros::<f32>("rates", 8)?;
        let before = [surface.field.n_steps(), ambient.n_steps()];
        let rows = [(&config.field.training, before[0]), (&ambient.config.training, before[1])];
        let [first, second] = rows.map(|(t, before)| schedule(t, before, n_steps));
        let table: Vec<[f32; 4]> = first.into_iter().zip(second).flat_map(|(a, b)| [a, b]).collect();
        let table = gpu.upload("schedule", &table)?;
        let shared = Shared { control: &control, n_at: N_AT, rates: &rates, rates_at: SURFACE_RATES };
        let shared_ambient = Shared { control: &control, n_at: RAYS_AT, rates: &rates, rates_at: AMBIENT_RATES };

        let pixels = gpu.upload("pixels", scene.pixels)?;
        let per_pixel: Vec<f32> = scene
            .measured
            .chunks_exact(k)
            .zip(scene.white.chunks_exact(n_channels))
            .flat_map(|(p, w)| p.iter().chain(w))
            .copied()
            .collect();
        let measured = gpu.upload("measured codewords", &per_pixel)?;
        let nodes = gpu.upload("the color field", lattice.nodes)?;
        let [lo, scale] = [lattice.lo, lattice.scale].map(|v| [v[0], v[1], v[2], 0.0]);
        let [m0, m1, m2] = lattice.affine;
        let frame = gpu.upload("the color field's frame", &[m0, m1, m2, [lattice.kappa, 0.0, 0.0, 0.0], lo, scale])?;
        let rays = gpu.zeros::<[u32; 4]>("rays", n_rays)?;
        let colors = gpu.zeros::<f32>("codewords", n * k)?;
        let steps = gpu.zeros::<[f32; 4]>("compositing", n)?;
        let (s, u) = (gpu.zeros::<f32>("gradients of distances", n)?, gpu.zeros::<[f32; 4]>("gradients of slopes", n)?);
        let of_ray = gpu.zeros::<[f32; 4]>("losses of rays", n_rays)?;
        let losses = gpu.zeros::<[f32; 4]>("losses", 1)?;
        let moments = &surface.sharpness_moments;
        let state = [surface.sharpness, moments.first[0], moments.second[0], surface.inv_s() as f32];
        let sharpness = gpu.upload("sharpness", &state)?;

        let cells_per_axis = occupancy.config.resolution;
        let n_cells = occupancy.cells.len();
        let cells = gpu.upload("cells", &occupancy.cells)?;
        let values = gpu.upload("occupancy", &occupancy.values)?;
        let words: Vec<u32> = occupancy.occupied.iter().flat_map(|w| [*w as u32, (*w >> 32) as u32]).collect();
        let occupied = gpu.upload("occupied cells", &words)?;
        let picked = gpu.zeros::<u32>("picked cells", n_cells)?;
        let threshold = gpu.zeros::<f32>("threshold", 1)?;

        let mut kernels = Kernels::new(gpu);
        let base = net
            .constants(&shared)
            .count("STEP_AT", STEP_AT)
            .count("RAYS_AT", RAYS_AT)
            .count("N_AT_SAMPLES", N_AT)
            .count("PICKED_AT", PICKED_AT)
            .count("BATCH_AT", BATCH_AT)
            .count("BEGIN_AT", BEGIN_AT)
            .count("SAVED_AT", SAVED_AT)
            .count("SEED", (scene.seed as u32 ^ (scene.seed >> 32) as u32) as usize)
            .count("K", k)
            .count("N_CHANNELS", n_channels)
            .count("RAY_CAPACITY", n_rays)
            .count("CELLS", cells_per_axis);
        let per_sample = [n / 64, 1, 1];
        let per_ray = [n_rays / 64, 1, 1];

        // The occupancy grid.
        let mut look = Vec::new();
        let next = include_str!("shaders/cells_next.wgsl");
        if n_cells > 0 {
            look.push(kernels.run("cells_restart", next, &base.clone().flag("RESTART", true), [1; 3], &[&control])?);
            let constants = base
                .clone()
                .count("N_CELLS", n_cells)
                .count("WARMUP", occupancy.config.n_warmup_steps as usize)
                .value("HALF_STEP", scene.half_step.into())
                .value("DECAY", occupancy.config.decay.into())
                .value("THRESHOLD", occupancy.config.threshold.into());
            let source = [RANDOM, include_str!("shaders/cells_pick.wgsl")].concat();
            let bindings: &[&dyn Binding] = &[&control, &cells, &occupied, &picked];
            look.push(kernels.run("cells_pick", &source, &constants, folded(n_cells, 256), bindings)?);
            let batch = kernels.run("cells_next", next, &base.clone().flag("NEXT", true), [1; 3], &[&control])?;
            let source = [RANDOM, include_str!("shaders/cells_points.wgsl")].concat();
            let points =
                kernels.run("cells_points", &source, &constants, per_sample, &[&control, &picked, &net.points])?;
            let forward = net.forward(&mut kernels, &shared)?;
            let source = include_str!("shaders/cells_write.wgsl");
            let bindings: &[&dyn Binding] = &[&control, &picked, &net.out, &sharpness, &values];
            let write = kernels.run("cells_write", source, &constants, per_sample, bindings)?;
            for _ in 0..n_cells.div_ceil(n) {
                look.extend([batch.clone(), points.clone()]);
                look.extend(forward.iter().cloned());
                look.push(write.clone());
            }
            look.push(kernels.run("cells_done", next, &base.clone().flag("DONE", true), [1; 3], &[&control])?);
            let source = [TOTAL, include_str!("shaders/cells_mean.wgsl")].concat();
            look.push(kernels.run("cells_mean", &source, &constants, [1; 3], &[&cells, &values, &threshold])?);
            let source = include_str!("shaders/cells_mark.wgsl");
            let groups = [cells_per_axis.pow(3).div_ceil(32 * 64), 1, 1];
            look.push(kernels.run("cells_mark", source, &constants, groups, &[&values, &threshold, &occupied])?);
        }

        // Rays, samples, codewords, ambient light.
        let constants = base
            .clone()
            .count("TARGET", scene.n_samples)
            .count("MAX_RAYS", scene.max_rays)
            .count("MAX_SAMPLES", n)
            .count("N_PIXELS", n_pixels)
            .value("STEP_T", scene.step.into())
            .value("ORIGIN_X", scene.origin[0].into())
            .value("ORIGIN_Y", scene.origin[1].into())
            .value("ORIGIN_Z", scene.origin[2].into())
            .count("CELLS_A", lattice.cells[0])
            .count("CELLS_B", lattice.cells[1])
            .count("CELLS_W", lattice.cells[2]);
        let source = include_str!("shaders/begin.wgsl");
        let mut draw = vec![kernels.run("begin", source, &constants, [1; 3], &[&control, &table, &rates])?];
        let source = [RANDOM, include_str!("shaders/draw.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&control, &pixels, &occupied, &rays, &net.points, &ambient_net.points];
        draw.push(kernels.run("draw", &source, &constants, per_ray, bindings)?);
        let source = include_str!("shaders/lattice.wgsl");
        let bindings: &[&dyn Binding] = &[&control, &net.points, &nodes, &frame, &colors];
        draw.push(kernels.run("lattice", source, &constants, per_sample, bindings)?);
        if scene.ambient != AmbientUse::None {
            draw.extend(ambient_net.forward(&mut kernels, &shared_ambient)?);
        }

        // The step itself.
        let mut step = net.forward(&mut kernels, &shared)?;
        step.extend(net.back_to_inputs(&mut kernels, &shared, true)?);
        let (levels, hashed, x, n_levels) = net.encoding();
        let constants = base
            .clone()
            .count("N_LEVELS", n_levels)
            .count("EVERY", settings.eikonal_every)
            .flag("EIKONAL", settings.eikonal_every > 0)
            .value("EIKONAL_WEIGHT", settings.eikonal_weight)
            .value("EXTENT_X", config.extent[0].into())
            .value("EXTENT_Y", config.extent[1].into())
            .value("EXTENT_Z", config.extent[2].into());
        let source = [LEVEL, include_str!("shaders/slopes.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&control, levels, hashed, &net.points, net.d_x(), &u];
        step.push(kernels.run("slopes", &source, &constants, per_sample, bindings)?);
        let min_white = match scene.ambient {
            AmbientUse::Intensity { min_white } => min_white,
            _ => 0.0,
        };
        let constants = base
            .clone()
            .value("L1", settings.norms.l1)
            .value("L2", settings.norms.l2)
            .value("ALPHA", settings.lookup_loss_weight)
            .value("MASK_WEIGHT", settings.mask_weight)
            .value("SPARSITY_WEIGHT", settings.sparsity_weight)
            .value("MASK_CLAMP", MASK_CLAMP)
            .value("MIN_OPACITY", MIN_OPACITY)
            .value("MIN_WHITE", min_white.into())
            .flag("BOUNDED", scene.ambient == AmbientUse::Share)
            .flag("UNBOUNDED", matches!(scene.ambient, AmbientUse::Intensity { .. }))
            .flag("CLAMPED", settings.clamped_mask);
        let source = include_str!("shaders/render.wgsl");
        let mut bindings: Vec<&dyn Binding> = vec![&control, &pixels, &rays, &net.out, &colors, &measured, &sharpness];
        let more: [&dyn Binding; 4] = [ambient_net.d_out(), &steps, &s, &of_ray];
        bindings.extend(more);
        if scene.ambient != AmbientUse::None {
            bindings.push(&ambient_net.out);
        }
        step.push(kernels.run("render", source, &constants, per_ray, &bindings)?);
        let source = [LEVEL, include_str!("shaders/tangents.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&control, levels, hashed, &net.points, x, &s, &u];
        step.push(kernels.run("tangents_x", &source, &base, [n / 64, n_levels, 1], bindings)?);
        step.extend(net.tangents(&mut kernels, &shared, &s)?);
        step.extend(net.descend(gpu, &mut kernels, &shared, Back::Distance { s: &s, u: &u })?);
        if scene.ambient != AmbientUse::None {
            step.extend(ambient_net.back_to_inputs(&mut kernels, &shared_ambient, false)?);
            step.extend(ambient_net.descend(gpu, &mut kernels, &shared_ambient, Back::Outputs)?);
        }
        let adam = &config.field.training.adam;
        let constants = base
            .clone()
            .value("BETA1", adam.beta1)
            .value("BETA2", adam.beta2)
            .value("EPSILON", adam.epsilon)
            .value("LEARNING_RATE", config.sharpness_learning_rate);
        let source = [ADAM, TOTAL, include_str!("shaders/sharpness.wgsl")].concat();
        step.push(kernels.run("sharpness", &source, &constants, [1; 3], &[&control, &rates, &of_ray, &sharpness])?);

        let source = [TOTAL, include_str!("shaders/losses.wgsl")].concat();
        let bindings: &[&dyn Binding] = &[&control, &of_ray, &u, &net.out, &losses];
        let record = vec![kernels.run("losses", &source, &base, [1; 3], bindings)?];
        Ok(Self {
            gpu: gpu.clone(),
            net,
            ambient: ambient_net,
            before,
            done: 0,
            n_steps,
            weights: [settings.mask_weight, settings.eikonal_weight, settings.sparsity_weight],
            every: occupancy.config.every,
            control,
            sharpness,
            losses,
            values,
            occupied,
            n_cells,
            rays,
            colors,
            look,
            draw,
            step,
            record,
        })
    }

    /// Measures the phases of a step, for `budget` seconds each: name, seconds, demand. Returns the seconds of a whole step. The training is of no use after it.
    pub(super) fn measure(
        &mut self,
        budget: f64,
        n_samples: usize,
        mut phase: impl FnMut(&'static str, f64, Demand),
    ) -> Result<f64, DeviceError> {
        let n = n_samples as f64;
        // The table's update clears what the scatter left, so the two are measured together.
        const PHASES: [(&str, &[&str]); 8] = [
            ("draw and codewords", &["begin", "draw", "lattice"]),
            ("encode", &["encode"]),
            ("layers", &["layer", "thin", "tangents"]),
            ("layers, back", &["layer_back", "thin_back"]),
            ("slopes", &["slopes", "tangents_x"]),
            ("compositing", &["render"]),
            ("network's gradient", &["gradient", "sum", "network", "sharpness"]),
            ("table's gradient, Adam", &["scatter", "table"]),
        ];
        let all: Vec<&Call> = self.draw.iter().chain(&self.step).collect();
        for (name, labels) in PHASES {
            let mut calls: Vec<Call> =
                all.iter().filter(|c| labels.contains(&c.label())).map(|c| (*c).clone()).collect();
            if labels.contains(&"scatter") {
                // The scatter adds to the table's gradient; both nets' tables come after both scatters otherwise.
                calls.sort_by_key(|c| c.label() == "table");
            }
            let secs = seconds(&self.gpu, &[&calls], budget)?;
            phase(name, secs, self.demand(name, n));
        }
        let steps = seconds(&self.gpu, &[&self.draw, &self.step], budget)?;
        Ok(steps)
    }

    /// What a phase asks for, of the surface's net alone (the ambient one is small).
    fn demand(&self, phase: &str, n: f64) -> Demand {
        let work = self.net.work();
        let k = (self.colors.len() / self.net.capacity) as f64;
        let (inner, macs) = (work.inner_macs, work.macs);
        let (flops, bytes) = match phase {
            // 64 nodes of k values.
            "draw and codewords" => (n * 128.0 * k, n * (4.0 * 64.0 * k + 16.0)),
            "encode" => (n * work.corner_values * 2.0, n * 4.0 * (work.corner_values + work.n_inputs)),
            // Values and tangents.
            "layers" => (2.0 * n * (macs + inner), n * 4.0 * 2.0 * work.unit_values),
            "layers, back" => (2.0 * n * macs, n * 4.0 * work.unit_values),
            // The slopes of every fourth sample, read twice.
            "slopes" => (n * work.corner_values, n * 4.0 * (0.5 * work.corner_values + 2.0 * work.n_inputs)),
            "compositing" => (n * 60.0, n * 4.0 * (2.0 + 8.0 + 2.0 + 3.0 * k)),
            "network's gradient" => (2.0 * n * macs, n * 4.0 * work.unit_values),
            // A value is read, added to and written; the table's gradient is read once, and its touched entries updated.
            _ => {
                let touched = (n * work.corner_values).min(work.n_table);
                (n * work.corner_values * 2.0, 4.0 * (2.0 * n * work.corner_values + work.n_table + 7.0 * touched))
            }
        };
        Demand { flops, bytes }
    }

    /// Steps done.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Trains until `until` steps are done, and looks how it went.
    ///
    /// # Errors
    ///
    /// The device failed; what it held is lost.
    pub fn run(&mut self, until: usize) -> Result<TrainingReport, DeviceError> {
        assert!(until <= self.n_steps && until > self.done);
        while self.done < until {
            // The grid counts its own steps; a training that goes on elsewhere looks at every cell again.
            let looks = (self.done as u64).is_multiple_of(self.every);
            let look: &[Call] = if looks { &self.look } else { &[] };
            let record: &[Call] = if self.done + 1 == until { &self.record } else { &[] };
            self.gpu.submit(&[look, &self.draw, &self.step, record])?;
            self.done += 1;
            if self.done.is_multiple_of(STEPS_AHEAD) {
                self.gpu.wait()?;
            }
        }
        self.report()
    }

    fn report(&self) -> Result<TrainingReport, DeviceError> {
        let [image, mask, eikonal, sparsity] = self.gpu.read(&self.losses, 1)?[0].map(f64::from);
        let [w_mask, w_eikonal, w_sparsity] = self.weights;
        let total = image + w_mask * mask + w_eikonal * eikonal + w_sparsity * sparsity;
        let control = self.gpu.read(&self.control, N_CONTROL)?;
        let occupied = self.gpu.read(&self.occupied, self.occupied.len())?;
        let n_occupied: u32 = occupied.iter().map(|w| w.count_ones()).sum();
        Ok(TrainingReport {
            losses: SurfaceLosses { total, image, mask, eikonal, sparsity },
            n_rays: control[RAYS_AT] as usize,
            n_samples: control[N_AT] as usize,
            inv_s: self.gpu.read(&self.sharpness, 4)?[3].into(),
            occupied: f64::from(n_occupied) / self.n_cells.max(1) as f64,
        })
    }

    /// Brings back what was trained, with the optimizers' state.
    ///
    /// # Errors
    ///
    /// The device failed; what was given may be changed in part.
    pub fn fetch(
        &self,
        surface: &mut NeuralSurface,
        ambient: &mut HashField<2>,
        occupancy: &mut OccupancyGrid,
    ) -> Result<(), DeviceError> {
        let steps = self.before.map(|b| b + self.done as u64);
        self.net.fetch(&self.gpu, steps[0], &mut surface.field)?;
        self.ambient.fetch(&self.gpu, steps[1], ambient)?;
        let [v, first, second, _]: [f32; 4] = self.gpu.read(&self.sharpness, 4)?.try_into().expect("four values");
        surface.sharpness = v;
        surface.sharpness_moments = MomentBuffers { first: vec![first], second: vec![second] };
        occupancy.values = self.gpu.read(&self.values, self.values.len())?;
        let words = self.gpu.read(&self.occupied, self.occupied.len())?;
        occupancy.occupied = words.chunks_exact(2).map(|w| u64::from(w[0]) | u64::from(w[1]) << 32).collect();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{test_gpu, test_gpu_alone};
    use super::*;
    use crate::check::assert_close;
    use crate::field::HashFieldConfig;
    use crate::mlp::Activation;
    use crate::occupancy::OccupancyConfig;
    use crate::surface::tests::{Rays, config, gradients, surface};

    fn ambient_field() -> HashField<2> {
        let config = HashFieldConfig { output_activation: Activation::Sigmoid, ..HashFieldConfig::small(2) };
        HashField::new(config, 2).unwrap()
    }

    /// One step on given rays: losses, gradients of all parameters, of the sharpness, and of the ambient shares.
    fn step(gpu: &Arc<Gpu>, start: &NeuralSurface, rays: &Rays) -> (SurfaceLosses, NeuralSurface, Vec<f32>) {
        let n_rays = rays.mask.len();
        let pixels: Vec<ScenePixel> = rays.mask.iter().map(|&mask| ScenePixel { mask, ..Default::default() }).collect();
        let scene = RayScene {
            pixels: &pixels,
            origin: [0.0; 3],
            step: 1.0,
            measured: &rays.measured,
            white: &rays.white,
            n_channels: 2,
            lattice: Lattice {
                nodes: &[0.0; 4 * 4 * 4 * 2],
                cells: [1; 3],
                k: 2,
                affine: [[0.0; 4]; 3],
                kappa: 0.0,
                lo: [0.0; 3],
                scale: [1.0; 3],
            },
            ambient: AmbientUse::Share,
            n_samples: rays.points.len(),
            first_rays: n_rays,
            max_rays: n_rays,
            half_step: 0.01,
            seed: 1,
        };
        let mut ambient = ambient_field();
        let mut occupancy = OccupancyGrid::new(OccupancyConfig { resolution: 8, ..Default::default() }, |_| true);
        let training = SurfaceTraining::new(gpu, start, &ambient, &occupancy, &scene, 1).unwrap();
        // The batch in the place of a drawn one.
        let spans: Vec<[u32; 4]> = (0..n_rays)
            .map(|r| [rays.offsets[r] as u32, (rays.offsets[r + 1] - rays.offsets[r]) as u32, r as u32, 0])
            .collect();
        let points: Vec<[f32; 4]> = rays.points.iter().map(|p| [p[0], p[1], p[2], 0.0]).collect();
        let by_row = |values: &[f32], capacity: usize| {
            let mut out = vec![0.0; 2 * capacity];
            for (i, v) in values.iter().enumerate() {
                out[i % 2 * capacity + i / 2] = *v;
            }
            out
        };
        gpu.submit(&[&training.draw[..1]]).unwrap();
        gpu.write(&training.control, &[rays.points.len() as u32, 1, n_rays as u32]);
        gpu.write(&training.rays, &spans);
        gpu.write(&training.net.points, &points);
        gpu.write(&training.colors, &by_row(&rays.colors, training.net.capacity));
        gpu.write(&training.ambient.out, &by_row(&rays.ambient, training.ambient.capacity));
        gpu.submit(&[&training.step, &training.record]).unwrap();
        let d_out = gpu.read(training.ambient.d_out(), 2 * training.ambient.capacity).unwrap();
        let d_ambient = (0..2 * n_rays)
            .map(|i| {
                let a = rays.ambient[i];
                d_out[i % 2 * training.ambient.capacity + i / 2] / (a * (1.0 - a))
            })
            .collect();
        let losses = training.report().unwrap().losses;
        let mut end = start.clone();
        training.fetch(&mut end, &mut ambient, &mut occupancy).unwrap();
        (losses, end, d_ambient)
    }

    #[test]
    fn a_step_agrees_with_the_cpu() {
        let cases = [(true, 1, true), (false, 0, false), (true, 1, false)];
        let gpus = [test_gpu(), test_gpu_alone(), test_gpu()];
        for (gpu, (append, every, clamped)) in gpus.into_iter().flatten().zip(cases) {
            let mut config = config(append);
            config.loss.eikonal_every = every;
            config.loss.clamped_mask = clamped;
            config.field.training.weight_normalization = append;
            let lengths: Vec<usize> = (0..150).map(|r| [16, 1, 0, 7, 32][r % 5]).chain([300, 5, 97]).collect();
            let rays = Rays::new(&lengths);
            let start = surface(config);
            let mut slow = start.clone();
            let mut d_expected = vec![0.0; rays.ambient.len()];
            let expected = slow.train_step(&rays.batch(), &mut d_expected);
            let (losses, fast, d_ambient) = step(&gpu, &start, &rays);
            for (a, b) in [
                (losses.total, expected.total),
                (losses.image, expected.image),
                (losses.mask, expected.mask),
                (losses.eikonal, expected.eikonal),
                (losses.sparsity, expected.sparsity),
            ] {
                assert!((a - b).abs() <= 2e-5 * b.abs(), "{losses:?} {expected:?}");
            }
            let relative = |a: &[f32], b: &[f32]| {
                let norm = |v: &mut dyn Iterator<Item = f32>| v.map(|v| f64::from(v * v)).sum::<f64>().sqrt();
                norm(&mut a.iter().zip(b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied())
            };
            // The CPU composites in double precision: long rays end on differences of small numbers here.
            let error = relative(&gradients(&fast), &gradients(&slow));
            assert!(error < 1e-4, "gradients differ by {error} ({append} {every} {clamped})");
            let error = relative(&d_ambient, &d_expected);
            assert!(error < 1e-4, "gradients of the ambient shares differ by {error}");
            let v = |s: &NeuralSurface| s.sharpness_moments.first[0];
            assert!((v(&fast) - v(&slow)).abs() < 1e-4 * v(&slow).abs(), "{} {}", v(&fast), v(&slow));
            assert!((fast.inv_s() - slow.inv_s()).abs() < 1e-4 * slow.inv_s());
        }
    }

    /// Rays along z through a lattice whose codewords tell z: a plane at 0.54 is seen where it is.
    #[test]
    fn a_training_finds_a_plane_and_goes_on_from_where_it_was() {
        let Some(gpu) = test_gpu() else { return };
        let mut settings = config(true);
        settings.extent = [3.0; 3];
        settings.sharpness = 0.3;
        settings.field.width = 16;
        settings.field.training.schedule.n_steps = 120;
        // f = 3 (0.5 - z): the plane of the start is in the middle.
        let mut surface = NeuralSurface::new(settings, 4).unwrap();
        for i in 0..400 {
            let p: Vec<[f32; 3]> = (0..512)
                .map(|j| {
                    let at = |m: f32| ((i * 512 + j) as f32 * m).fract();
                    [at(0.754_87), at(0.569_84), at(0.618_03)]
                })
                .collect();
            let targets: Vec<f32> = p.iter().map(|p| 3.0 * (0.5 - p[2])).collect();
            surface.field_mut().train_step(&p, &targets, &[]);
        }
        surface.field_mut().finish_training();
        let cells = [4usize, 4, 24];
        let [na, nb, nw] = cells.map(|c| c + 3);
        let node = |i: usize| {
            let w = (i % nw) as f32 / 24.0 - 1.0 / 24.0;
            [0.5 + 0.4 * (9.0 * w).sin(), 0.5 + 0.4 * (9.0 * w).cos()]
        };
        let nodes: Vec<f32> = (0..na * nb * nw).flat_map(node).collect();
        let (mut pixels, mut measured) = (Vec::new(), Vec::new());
        for i in 0..24 * 24 {
            let at = |v: usize| (v as f32 + 0.5) / 24.0;
            let slope = [at(i % 24) - 0.5, at(i / 24) - 0.5];
            pixels.push(ScenePixel {
                // From below the cube's middle, fanning out.
                dir: [0.2 * slope[0], 0.2 * slope[1], 0.5],
                near: 2.0,
                far: 4.0,
                place: [at(i % 24), at(i / 24)],
                mask: 1.0,
            });
            measured.extend([0.5 + 0.4 * (9.0f32 * 0.54).sin(), 0.5 + 0.4 * (9.0f32 * 0.54).cos()]);
        }
        let scene = RayScene {
            pixels: &pixels,
            origin: [0.5, 0.5, -1.0],
            step: 0.02,
            measured: &measured,
            white: &vec![0.8; pixels.len()],
            n_channels: 1,
            lattice: Lattice {
                nodes: &nodes,
                cells,
                k: 2,
                affine: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
                kappa: 0.0,
                lo: [0.0; 3],
                scale: [1.0; 3],
            },
            ambient: AmbientUse::Share,
            n_samples: 2000,
            first_rays: 16,
            max_rays: 128,
            half_step: 0.01,
            seed: 3,
        };
        let config = HashFieldConfig { output_activation: Activation::Sigmoid, ..HashFieldConfig::small(1) };
        let mut ambient = HashField::<2>::new(config, 2).unwrap();
        let occupancy_config = OccupancyConfig { resolution: 12, n_warmup_steps: 32, ..Default::default() };
        let mut occupancy = OccupancyGrid::new(occupancy_config, |_| true);
        let depth = |surface: &NeuralSurface| {
            let mut out = [0.0; 2];
            surface.field().query(&[[0.4, 0.5, 0.52], [0.6, 0.5, 0.56]], &mut out);
            out
        };
        let mut training = SurfaceTraining::new(&gpu, &surface, &ambient, &occupancy, &scene, 120).unwrap();
        let early = training.run(40).unwrap();
        assert!(early.n_rays > 16 && early.n_samples > 700, "{early:?}");
        let late = training.run(120).unwrap();
        assert!(late.losses.image < 0.7 * early.losses.image, "{early:?} {late:?}");
        assert!(late.inv_s > early.inv_s && late.occupied < 1.0, "{early:?} {late:?}");
        training.fetch(&mut surface, &mut ambient, &mut occupancy).unwrap();
        let [before, behind] = depth(&surface);
        assert!(before > 0.0 && behind < 0.0, "{before} {behind}");
        assert_eq!((surface.field().n_steps(), ambient.n_steps()), (120, 120));
        assert!((occupancy.share() - late.occupied).abs() < 1e-9);
        assert!(occupancy.is_occupied([0.5, 0.5, 0.54]) && !occupancy.is_occupied([0.5, 0.5, 0.1]));
        // As if nothing had happened.
        let mut again = SurfaceTraining::new(&gpu, &surface, &ambient, &occupancy, &scene, 10).unwrap();
        let after = again.run(10).unwrap();
        assert!(after.losses.image < 2.0 * late.losses.image && again.done() == 10, "{late:?} {after:?}");
        assert_close(&[after.inv_s as f32], &[late.inv_s as f32], 0.2);
    }
}
