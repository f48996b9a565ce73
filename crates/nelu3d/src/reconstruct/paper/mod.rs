//! Recipe `paper`: the published reconstruction (paper, Sec. 3; settings in TurboSL's public configuration, from which it
//! derives).
//!
//! A hash-encoded signed distance field is trained from a plane or sphere by volume rendering of the frozen color field, with an
//! ambient term A(u, v) over the image, for 10,000 iterations. Nothing of what recipe `fast` knows (noise, ambiguity, depth
//! jumps, interreflection) is used. Fig. 7's ablations are settings.

mod ambient;
mod batch;
#[cfg(feature = "gpu")]
mod on_gpu;

use nelu3d_field::device::Device;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::{NeuralSurface, SurfaceLoss};
use nelu3d_scan::Camera;
use nelu3d_scan::rig::Capture;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::assemble::{Maps, assemble};
use super::lookup::{Lookup, Rays};
use super::measure::Measurements;
use super::{Failure, Observer, Options, Stage, why_nothing};
use crate::color_field::ColorField;
use crate::progress::Progress;
use crate::result::{Left, Reconstruction, StageClock};
use crate::sdf::{self, Start, view};
pub use ambient::Ambient;
use ambient::AmbientField;
use batch::{Batch, Pixels};

/// Iterations unless asked otherwise.
const ITERATIONS: usize = 10_000;

/// L_eik is a mean over samples; every fourth sample of a step estimates it as well, for two thirds of the time.
const EIKONAL_EVERY: usize = 4;

/// Rays whose pixel is too dark to show an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// They are not drawn: all rays go to pixels with a codeword
    #[default]
    Crop,
    /// They are drawn, with the published mask loss, which has no gradient where the start blocks them for certain
    Clamped,
    /// They are drawn, with a mask loss that does not saturate; it can push a plane behind the object
    Carve,
}

/// Settings of recipe `paper`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "Recipe `paper` and TurboSL"))]
#[serde(default, deny_unknown_fields)]
pub struct PaperOptions {
    /// First shape of the signed distance field
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Start::Plane))]
    pub start: Start,
    /// α of Eq. 4: 1 for the lookup loss alone, 0 for the pattern loss alone
    #[cfg_attr(feature = "clap", arg(long, value_name = "A", default_value_t = 0.1, value_parser = share))]
    pub lookup_loss_weight: f64,
    /// The ambient term
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Ambient::Bounded))]
    pub ambient: Ambient,
    /// What becomes of rays that miss the object
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Background::Crop))]
    pub background: Background,
    /// Samples per iteration; the number of rays follows
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 262_144))]
    pub samples: usize,
}

#[cfg(feature = "clap")]
fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if (0.0..=1.0).contains(&v) => Ok(v),
        _ => Err("a number from 0 to 1".into()),
    }
}

impl Default for PaperOptions {
    fn default() -> Self {
        Self {
            start: Start::Plane,
            lookup_loss_weight: 0.1,
            ambient: Ambient::Bounded,
            background: Background::Crop,
            samples: 262_144,
        }
    }
}

/// The losses around an iteration, as they are recorded.
#[derive(Clone, Copy, Debug, Serialize)]
struct Record {
    iteration: usize,
    image: f64,
    mask: f64,
    eikonal: f64,
    sparsity: f64,
    inv_s_per_mm: f64,
    rays: usize,
    samples: usize,
    occupied: f64,
}

impl Record {
    #[cfg(feature = "gpu")]
    fn on_gpu(report: &nelu3d_field::gpu::TrainingReport, iteration: usize, unit_mm: f64) -> Self {
        Self {
            iteration,
            image: report.losses.image,
            mask: report.losses.mask,
            eikonal: report.losses.eikonal,
            sparsity: report.losses.sparsity,
            inv_s_per_mm: report.inv_s / unit_mm,
            rays: report.n_rays,
            samples: report.n_samples,
            occupied: report.occupied,
        }
    }
}

fn diverged(iteration: usize) -> Failure {
    let text =
        format!("training diverged at iteration {iteration}: the loss is not a number; try another --seed or --start");
    Failure::Nothing(text)
}

/// Reconstructs a capture.
pub(crate) fn reconstruct(
    capture: &Capture,
    camera: &Camera,
    field: &ColorField,
    opts: &Options,
    progress: &Progress,
    clock: &mut StageClock<'_>,
    mut observer: Option<&mut dyn Observer>,
) -> Result<Reconstruction, Failure> {
    let settings = &opts.paper;
    let n_steps = opts.steps.unwrap_or(ITERATIONS);
    clock.begin("prepare");
    let grid = field.to_grid();
    let mut m = Measurements::new(capture, &field.about.noise, &field.about.dark, super::model_sigma(field));
    let lookup = Lookup::new(&grid, field.about.fineness);
    let rays = Rays::new(camera, field, 1);
    let pixels = Pixels::new(&m, &rays, settings.background).ok_or_else(|| Failure::Nothing(why_nothing(&m.left)))?;
    let bounds = pixels.bounds;

    clock.begin("give the field its start");
    let loss = SurfaceLoss {
        lookup_loss_weight: settings.lookup_loss_weight,
        clamped_mask: settings.background != Background::Carve,
        eikonal_every: EIKONAL_EVERY,
        ..SurfaceLoss::default()
    };
    let mut surface = settings.start.surface(sdf::surface_config(loss, n_steps), opts.seed);
    let mut ambient = AmbientField::new(settings.ambient, capture.white.channels, n_steps, opts.seed);
    let mut occupancy = OccupancyGrid::new(sdf::occupancy_config(), |q| pixels.reaches(camera, &rays, q));

    clock.begin("train by volume rendering");
    let mut n_rays = sdf::FIRST_RAYS;
    let mut records = Vec::new();
    let mut batch = Batch::default();
    let device = Device::or_cpu(opts.device);
    #[allow(unused_mut)]
    let mut done = 0;
    #[cfg(feature = "gpu")]
    if let Device::Gpu(gpu) = &device {
        let scene = on_gpu::Scene::new(&pixels, &m, &rays, &grid, field, settings, opts.seed);
        let mut parts = on_gpu::Parts { surface: &mut surface, ambient: &mut ambient, occupancy: &mut occupancy };
        let is_observed = observer.is_some();
        let mut on_report = |report: &nelu3d_field::gpu::TrainingReport, done: usize| {
            records.push(Record::on_gpu(report, done, bounds.unit_mm));
            report.losses.total.is_finite()
        };
        let mut on_look = |parts: &on_gpu::Parts<'_>, done: usize| {
            let Some(o) = observer.as_deref_mut() else { return };
            clock.pause();
            o.surface(Stage::Refine, done, &see(parts.surface, &pixels, &rays, parts.occupancy, &m).depth);
            clock.resume();
        };
        let watch = on_gpu::Watch { is_observed, on_report: &mut on_report, on_look: &mut on_look };
        (done, n_rays) = scene.train(gpu, &mut parts, n_steps, progress, watch)?;
    }
    for step in done..n_steps {
        if progress.cancelled() {
            return Err(Failure::Cancelled);
        }
        sdf::update_occupancy(&mut occupancy, &surface, step as u64, opts.seed);
        batch.draw(&pixels, &m, &rays, &lookup, &occupancy, n_rays, opts.seed, step as u64);
        let losses = batch.step(&mut surface, &mut ambient);
        let n_samples = batch.n_samples();
        if step % 100 == 0 || step + 1 == n_steps {
            records.push(Record {
                iteration: step + 1,
                image: losses.image,
                mask: losses.mask,
                eikonal: losses.eikonal,
                sparsity: losses.sparsity,
                inv_s_per_mm: surface.inv_s() / bounds.unit_mm,
                rays: n_rays,
                samples: n_samples,
                occupied: occupancy.occupied_fraction(),
            });
            tracing::info!(
                ?losses,
                inv_s = surface.inv_s(),
                n_rays,
                n_samples,
                occupied = occupancy.occupied_fraction(),
                step
            );
            if !losses.total.is_finite() {
                return Err(diverged(step + 1));
            }
        }
        n_rays = sdf::next_ray_count(n_rays, n_samples, settings.samples);
        progress.tick(step + 1, n_steps);
        if let Some(o) = observer.as_deref_mut()
            && watched(step + 1, n_steps)
        {
            clock.pause();
            let seen = see(&surface, &pixels, &rays, &occupancy, &m);
            o.surface(Stage::Refine, step + 1, &seen.depth);
            clock.resume();
        }
    }

    clock.begin("render the surface");
    let seen = see(&surface, &pixels, &rays, &occupancy, &m);
    for i in 0..m.n() {
        if m.left[i] == Left::Kept && seen.depth[i].is_nan() {
            let [near, far] = rays.range[i];
            m.left[i] = if near > far { Left::Outside } else { Left::Ambiguous };
        }
    }
    if seen.depth.iter().all(|z| z.is_nan()) {
        return Err(Failure::Nothing(why_nothing(&m.left)));
    }
    if let Some(o) = observer {
        clock.pause();
        o.surface(Stage::Result, 1, &seen.depth);
        clock.resume();
    }
    let shares = ambient.shares(&m);
    let k = m.k;
    let n_channels = capture.white.channels;
    let mut c = vec![0.0; k];
    let (mut residual, mut mean_ambient) = (vec![f32::NAN; m.n()], vec![f32::NAN; m.n()]);
    for i in (0..m.n()).filter(|&i| seen.depth[i].is_finite()) {
        let q = rays.in_frame(i).at(f64::from(seen.depth[i] / rays.dir_z(i))).q;
        lookup.eval(q, &mut c);
        let share = &shares[i * n_channels..][..n_channels];
        let square = |j: usize| {
            let a = share[j % n_channels];
            (c[j] * (1.0 - a) + a - m.p[i * k + j]).powi(2)
        };
        residual[i] = ((0..k).map(square).sum::<f32>() / k as f32).sqrt();
        mean_ambient[i] = share.iter().sum::<f32>() / n_channels as f32;
    }

    clock.begin("build the surface");
    let mut info = serde_json::Map::new();
    info.insert("settings".into(), serde_json::to_value(opts).expect("plain data serializes"));
    info.insert("iterations".into(), json!(n_steps));
    info.insert("device".into(), json!(device.name()));
    info.insert("unit_mm".into(), json!(bounds.unit_mm));
    info.insert(
        "field".into(),
        json!({ "rig": field.about.rig, "set": field.about.set, "form": field.form_name(), "source": field.about.source }),
    );
    info.insert("losses".into(), serde_json::to_value(records).expect("plain data serializes"));
    let mut out = assemble(
        Maps { depth: seen.depth, sigma: seen.spread, left: m.left, residual, ambient: mean_ambient },
        camera,
        &rays.plane,
        &capture.white,
        info,
    );
    // The field's own gradient, not that of the depth map.
    for (n, own) in out.normals.iter_mut().zip(&seen.normals) {
        if own[0].is_finite() && n[0].is_finite() {
            *n = *own;
        }
    }
    Ok(out)
}

/// Whether an observer sees the surface after this many iterations: a few times at first, then every thousand.
fn watched(done: usize, n_steps: usize) -> bool {
    matches!(done, 100 | 200 | 350 | 500 | 700) || done.is_multiple_of(1000) || done == n_steps
}

/// What the camera sees of the surface; NaN where nothing is.
struct Seen {
    depth: Vec<f32>,
    spread: Vec<f32>,
    normals: Vec<[f32; 3]>,
}

fn see(surface: &NeuralSurface, pixels: &Pixels, rays: &Rays, grid: &OccupancyGrid, m: &Measurements) -> Seen {
    let n = m.n();
    let mut out = Seen { depth: vec![f32::NAN; n], spread: vec![f32::NAN; n], normals: vec![[f32::NAN; 3]; n] };
    let lit: Vec<usize> = pixels.lit().collect();
    let marches: Vec<_> = lit.iter().map(|&i| pixels.march(rays, i, 0.5)).collect();
    let seen = view::view(surface, &pixels.bounds, grid, &marches);
    let normals = view::normals(surface, &pixels.bounds, &marches, &seen.t);
    for (r, &i) in lit.iter().enumerate() {
        out.depth[i] = seen.t[r] * rays.dir_z(i);
        out.spread[i] = seen.spread[r] * rays.dir_z(i);
        out.normals[i] = normals[r];
    }
    out
}
