//! Recipe `paper`: the published reconstruction (paper, Sec. 3; settings in TurboSL's public configuration, from which
//! it derives).
//!
//! A hash-encoded signed distance field is trained by volume rendering of the frozen color field, with an ambient term
//! A(u, v) over the image, for 10,000 iterations. It begins as the surface that recipe `fast` decodes from its cost
//! volume, or as published with nothing, or as a plane or a sphere; nothing else of what `fast` knows (noise, depth
//! jumps, interreflection) is used. Fig. 7's ablations are settings.
//!
//! With fewer iterations or samples than published, the same schedules run in proportion, and samples are placed where
//! the surface may be.

mod ambient;
mod batch;
pub mod bounds;
pub mod checkpoint;
mod codewords;
pub mod config;
#[doc(hidden)]
pub mod distances;
mod identity;
pub mod importance;
mod learned;
#[doc(hidden)]
pub mod lookup_start;
pub mod march;
#[cfg(feature = "gpu")]
#[doc(hidden)]
pub mod on_gpu;
mod options;
mod record;
pub mod start;
mod training;
pub mod view;

use std::borrow::Cow;

use nelu3d_scan::Camera;
use nelu3d_scan::rig::Capture;

use super::context::Context;
use super::diagnostics::{PaperDiagnostics, RecipeDiagnostics};
use super::error::Failure;
use super::filter::nothing_left;
use super::initialize::initialize;
use super::judge::judge;
use super::lit_part::LitPart;
use super::observer::Stage;
use super::options::{CrosstalkMode, ReconstructionOptions};
use super::scene::Scene;
use super::settings::FastSettings;
use crate::color_field::ColorField;
use crate::surface::{PixelStatus, Surface, SurfaceMaps, assemble};
use crate::verdict::Judgment;
pub use ambient::{Ambient, AmbientField};
use batch::TrainingPixels;
pub use checkpoint::{CheckpointOptions, TrainingCheckpointError};
use codewords::Codewords;
use identity::identity;
use learned::Learned;
use march::RaySamples;
#[cfg(feature = "clap")]
pub use options::positive;
pub use options::{Background, PaperOptions, PaperStart};
pub use record::TrainingRecord;
use training::Training;
use view::RenderedView;

/// Number of iterations unless another is asked for.
const ITERATIONS: usize = 10_000;

/// Smallest standard deviation of the color field itself, normalized intensity: it decides which pixels are
/// underexposed, not how losses are weighed.
const MIN_MODEL_SIGMA: f32 = 0.005;
/// Largest one: a field that errs more between its boards, as form `published` does in a sweep of few, leaves no pixel
/// otherwise, and the mask M is about light alone.
const MAX_MODEL_SIGMA: f32 = 0.05;

/// Reconstructs a capture by training.
pub(super) fn reconstruct(
    capture: &Capture,
    camera: &Camera,
    field: &ColorField,
    opts: &ReconstructionOptions,
    cx: &mut Context<'_>,
) -> Result<(Surface, RecipeDiagnostics, Judgment), Failure> {
    let n_steps = opts.steps.unwrap_or(ITERATIONS);
    let model_sigma = field.metadata.model_sigma(MIN_MODEL_SIGMA).min(MAX_MODEL_SIGMA);
    cx.clock.begin("prepare");
    let whole = LitPart::whole(camera.width, camera.height);
    let mut scene = Scene::measure(Cow::Borrowed(capture), camera, whole, field, model_sigma, |_| true, cx)?;
    let pixels =
        TrainingPixels::new(&scene.measurements, &scene.rays, &opts.paper).ok_or_else(|| nothing_left(&scene))?;

    let checkpoint = opts.paper.checkpoint.of(|| identity(&scene, &pixels, opts, n_steps));
    let mut learned = Learned::new(&scene, &pixels, opts, n_steps);
    let resumed = checkpoint.as_ref().map(|c| c.load(&mut learned.parts_mut())).transpose()?.flatten();
    if resumed.is_none() {
        let decoded = if opts.paper.start == PaperStart::Lookup { Some(decode(&mut scene, opts, cx)?) } else { None };
        cx.clock.begin("give the field its start");
        learned.start(&scene, &pixels, opts, decoded.as_deref());
    }
    cx.clock.begin("train by volume rendering");
    let reached = resumed.unwrap_or_default();
    let (scene_read, checkpoint) = (&scene, checkpoint.as_ref());
    let mut training = Training { scene: scene_read, pixels: &pixels, opts, n_steps, learned, reached, checkpoint };
    training.run(cx)?;
    if let Some(checkpoint) = checkpoint {
        checkpoint.remove();
    }

    cx.clock.begin("render the surface");
    let view = training.render_view();
    let Training { learned, reached, .. } = training;
    reject_transparent(&mut scene, &view)?;
    cx.observe(Stage::Result, 1, || view.depth.clone());
    let (residual, mean_ambient) = residuals(&scene, &view, &learned.ambient);

    cx.clock.begin("build the surface");
    let judgment = judge(&scene, &view.depth, None, None);
    let status = scene.measurements.status;
    let maps = SurfaceMaps { depth: view.depth, sigma: view.spread, status, residual, ambient: mean_ambient };
    let mut surface = assemble(maps, camera, &scene.rays.plane, &capture.white);
    // The field's own gradient, not that of the depth map.
    surface.replace_normals(&view.normals);
    let diagnostics = PaperDiagnostics { iterations: n_steps, unit_mm: pixels.bounds.unit_mm, losses: reached.records };
    Ok((surface, RecipeDiagnostics::Paper(diagnostics), judgment))
}

/// Decodes the depth map from which training starts, camera z in mm; NaN where there is none. The measurements stay as
/// they are.
fn decode(scene: &mut Scene<'_>, opts: &ReconstructionOptions, cx: &mut Context<'_>) -> Result<Vec<f32>, Failure> {
    let measured = scene.measurements.clone();
    let initial = initialize(scene, None, CrosstalkMode::Off, &FastSettings::new(opts), cx);
    scene.measurements = measured;
    Ok(initial?.depth.inv_z.iter().map(|inv_z| 1.0 / inv_z).collect())
}

/// Rejects valid pixels to which rendering gave no depth.
fn reject_transparent(scene: &mut Scene<'_>, view: &RenderedView) -> Result<(), Failure> {
    let Scene { rays, measurements: m, .. } = scene;
    for i in 0..m.n() {
        if m.status[i] == PixelStatus::Valid && view.depth[i].is_nan() {
            let [near, far] = rays.range[i];
            m.status[i] = if near > far { PixelStatus::OutsideVolume } else { PixelStatus::Ambiguous };
        }
    }
    if view.depth.iter().all(|z| z.is_nan()) { Err(nothing_left(scene)) } else { Ok(()) }
}

/// Returns the RMS residual of the normalized intensities, and the ambient fraction, mean over channels, per pixel; NaN
/// where there is no depth.
fn residuals(scene: &Scene<'_>, view: &RenderedView, ambient: &AmbientField) -> (Vec<f32>, Vec<f32>) {
    let (m, rays) = (&scene.measurements, &scene.rays);
    let fractions = ambient.fractions(m);
    let (k, n_channels) = (m.k, scene.white.channels);
    let (mut residual, mut mean_ambient) = (vec![f32::NAN; m.n()], vec![f32::NAN; m.n()]);
    let hits: Vec<usize> = (0..m.n()).filter(|&i| view.depth[i].is_finite()).collect();
    // One sample a ray, where it meets the surface.
    let t = hits.iter().map(|&i| view.depth[i] / rays.dir_z(i)).collect();
    let samples = RaySamples { offsets: (0..=hits.len()).collect(), t, ..RaySamples::default() };
    let mut codewords = vec![0.0; hits.len() * k];
    Codewords::of(scene).along_rays(rays, &samples, |r| hits[r], &mut codewords);
    for (&i, c) in hits.iter().zip(codewords.chunks_exact(k)) {
        let fraction = &fractions[i * n_channels..][..n_channels];
        let square = |j: usize| {
            let a = fraction[j % n_channels];
            (c[j] * (1.0 - a) + a - m.p[i * k + j]).powi(2)
        };
        residual[i] = ((0..k).map(square).sum::<f32>() / k as f32).sqrt();
        mean_ambient[i] = fraction.iter().sum::<f32>() / n_channels as f32;
    }
    (residual, mean_ambient)
}
