//! Reconstruction: from a color field and the captures of a scene to a surface.
//!
//! Recipe `fast`, in five stages: measure (normalize, reject unusable pixels) → initialize (cost volume and semi-global
//! matching, or the previous frame) → refine (narrow-band volume rendering) → filter (reject what is not supported) →
//! assemble (normals, mesh). Recipe `paper` is the published one, in [`neural`].

mod codewords;
mod context;
#[doc(hidden)]
pub mod cost_volume;
mod demand;
mod diagnostics;
mod effort;
mod error;
#[doc(hidden)]
pub mod filter;
#[doc(hidden)]
pub mod initialize;
#[doc(hidden)]
pub mod judge;
mod light_fractions;
mod lit_part;
mod maps;
pub mod neural;
mod observer;
mod options;
#[doc(hidden)]
pub mod outline;
mod pixel_beside;
mod previous;
#[doc(hidden)]
pub mod refine;
mod scene;
mod settings;

use std::borrow::Cow;

use nelu3d_scan::rig::{Capture, Need, PatternSet, Shot};
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Camera, Rig};
use rayon::prelude::*;

use crate::color_field::{ColorField, check_field, check_mono};
use crate::drift::check_capture;
use crate::progress::{Progress, StageTime};
use crate::surface::{Links, MAX_SLOPE, PixelStatus, Surface, SurfaceMaps, assemble};
use crate::verdict::Judgment;
pub use codewords::Codeword;
pub(crate) use codewords::decode_codewords;
pub use context::Context;
pub use cost_volume::CostVolumeSettings;
pub use diagnostics::{Diagnostics, FieldOrigin, RecipeDiagnostics};
use diagnostics::{FastDiagnostics, Start};
pub use effort::{Effort, EffortSettings};
pub use error::{Failure, ReconstructionError};
pub use filter::FilterSettings;
use filter::filter;
pub use initialize::{CrosstalkSettings, PropagationSettings};
use initialize::{Initial, initialize};
use judge::judge;
pub use light_fractions::LightFractionPrior;
pub use lit_part::LitPart;
pub(crate) use maps::interpolate_within;
pub use observer::{Observer, Stage};
pub use options::{CrosstalkMode, Recipe, ReconstructionOptions};
use outline::sigma_of_place;
pub use previous::PreviousFrame;
pub use refine::RefineSettings;
use refine::{Refined, refine};
use scene::Scene;
pub use settings::FastSettings;

/// A reconstructed scene.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// The surface.
    pub surface: Surface,
    /// Diagnostics of the method.
    pub diagnostics: Diagnostics,
    /// Wall and CPU time of each stage, in order.
    pub stages: Vec<StageTime>,
}

/// Reconstructs a scene of a rig.
///
/// # Errors
///
/// The field belongs to something else, an image cannot be read, the device is not there, no pixel can be
/// reconstructed, or the caller stopped the work.
pub fn reconstruct(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    field: &ColorField,
    opts: &ReconstructionOptions,
    progress: &Progress,
) -> Result<Reconstruction, ReconstructionError> {
    reconstruct_observed(rig, set, shot, field, opts, progress, None)
}

/// Reconstructs a scene of a rig, and shows every intermediate surface to an observer. The result is that of
/// [`reconstruct`].
///
/// # Errors
///
/// The errors are those of [`reconstruct`].
pub fn reconstruct_observed<'a>(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    field: &ColorField,
    opts: &ReconstructionOptions,
    progress: &'a Progress,
    observer: Option<&'a mut (dyn Observer + 'a)>,
) -> Result<Reconstruction, ReconstructionError> {
    check_field(rig, set, field)?;
    let mut cx = Context::new(progress, opts.device)?.with_observer(observer);
    cx.clock.begin("read the scene");
    let capture = rig.read_shot(shot, set, Need::Scene)?;
    check_mono(&capture, set, shot, field)?;
    cx.clock.begin("look for drift");
    let drift = check_capture(rig, &capture, field);
    let (surface, mut diagnostics) = reconstruct_capture(Cow::Owned(capture), &rig.camera, field, None, opts, &mut cx)
        .map_err(|failure| failure.at(&shot.dir))?;
    diagnostics.add_drift(drift);
    Ok(Reconstruction { surface, diagnostics, stages: cx.finish() })
}

/// Reconstructs a capture, from the previous frame's surface if there is one (recipe `fast`). Whether something moved
/// since the sweep is not looked at. Of a capture that is handed over, no more is kept than is needed.
///
/// # Errors
///
/// No pixel can be reconstructed, or the caller stopped the work.
pub fn reconstruct_capture(
    capture: Cow<'_, Capture>,
    camera: &Camera,
    field: &ColorField,
    previous: Option<&PreviousFrame>,
    opts: &ReconstructionOptions,
    cx: &mut Context<'_>,
) -> Result<(Surface, Diagnostics), Failure> {
    cx.part = None;
    let (surface, recipe, judgment) = match opts.recipe {
        Recipe::Fast => fast(capture, camera, field, previous, opts, cx)?,
        Recipe::Paper => neural::reconstruct(&capture, camera, field, opts, cx)?,
    };
    let (settings, device) = (opts.clone(), cx.device.name());
    Ok((surface, Diagnostics { judgment, settings, device, field: field.into(), drift: None, recipe }))
}

/// Recipe `fast`: measure, initialize, refine, filter, assemble.
fn fast(
    capture: Cow<'_, Capture>,
    camera: &Camera,
    field: &ColorField,
    previous: Option<&PreviousFrame>,
    opts: &ReconstructionOptions,
    cx: &mut Context<'_>,
) -> Result<(Surface, RecipeDiagnostics, Judgment), Failure> {
    let mut settings = FastSettings::new(opts);
    let model_sigma = field.metadata.model_sigma(settings.min_model_sigma);
    cx.clock.begin("prepare");
    let part = LitPart::of(&capture, &field.metadata.noise, &field.metadata.dark);
    let ((capture, white), camera) = (part.of_capture(capture), part.camera(camera));
    let previous = previous.map(|previous| PreviousFrame { depth: part.cut(&previous.depth, 1), ..previous.clone() });
    cx.part = Some(part);
    let lit = |status| status != PixelStatus::Underexposed;
    let mut scene = Scene::measure(capture, &camera, part, field, model_sigma, lit, cx)?;
    let initial = initialize(&mut scene, previous.as_ref(), opts.cross_talk, &settings, cx)?;
    if initial.decoded.is_some() {
        settings = settings.after_previous_frame(opts);
    }
    let board = initial.crosstalk.and_then(|_| scene.board_white());
    let refined = refine(&scene, &initial.depth, &settings.refine, (&settings.light_fractions, board), cx)?;
    let (progress, n, k) = (cx.progress, scene.measurements.n(), scene.measurements.k);
    let (step, prior) = (initial.depth.step, settings.light_fractions);
    let (depth, support) = progress.measure("filter", || {
        (filter(&mut scene, &refined, step, &settings.filter, &prior, cx), demand::filter(n, k))
    })?;
    cx.observe(Stage::Result, 1, || depth.clone());
    cx.clock.begin("build the surface");
    let diagnostics = diagnose(&initial, &refined, &depth, settings);
    let (judgment, sigma) = rayon::join(
        || judge(&scene, &depth, Some(&refined.chi2), support),
        || sigma_mm(&scene, &refined.sigma, &depth),
    );
    let surface = progress.measure("mesh", || (build_surface(scene, refined, depth, sigma), demand::mesh(n)));
    let surface = match white {
        Some(white) => part.surface(surface, white.into_owned()),
        None => surface,
    };
    Ok((surface, RecipeDiagnostics::Fast(Box::new(diagnostics)), judgment))
}

/// Returns what recipe `fast` puts on record.
fn diagnose(initial: &Initial, refined: &Refined, depth: &[f32], fast: FastSettings) -> FastDiagnostics {
    let mut residuals: Vec<f32> =
        (0..depth.len()).filter(|i| depth[*i].is_finite()).map(|i| refined.abs_residual[i]).collect();
    FastDiagnostics {
        effort: EffortSettings {
            decoded_pixels: fast.max_decoded_pixels,
            steps: fast.refine.steps,
            fine_steps: fast.refine.fine_steps,
            gathers: fast.refine.gathers,
            patches: fast.refine.patches,
        },
        fast,
        start: initial.decoded.map_or(Start::Scene, |decoded| Start::PreviousFrame { decoded }),
        crosstalk: initial.crosstalk,
        losses: refined.losses.clone(),
        albedo: refined.albedo.clone(),
        mixing_left: refined.crosstalk,
        flash_offset_mm: refined.flash_offset_mm,
        median_residual: median(&mut residuals).expect("a surface has valid pixels"),
    }
}

/// Returns 1σ of every depth, mm (NaN where there is none): `of_inverse` in 1/mm, what poses of the boards are off by,
/// and where in its pixel a depth was measured.
fn sigma_mm(scene: &Scene<'_>, of_inverse: &[f32], depth: &[f32]) -> Vec<f32> {
    let pose = |i: usize, z: f32| {
        let q = scene.rays.in_frame(i).at(f64::from(z / scene.rays.dir_z(i))).q;
        scene.field.pose_sigma_mm(scene.rays.plane[i], q)
    };
    let place = sigma_of_place(depth, &Links::new(depth, scene.camera, MAX_SLOPE), scene.camera.width);
    let sigma = |(i, (z, s)): (usize, (&f32, &f32))| match z.is_finite() {
        true => (s * z * z).hypot(pose(i, *z)).hypot(place[i]),
        false => f32::NAN,
    };
    depth.par_iter().zip(of_inverse).enumerate().map(sigma).collect()
}

/// Links, normals and mesh of the valid depths.
fn build_surface(scene: Scene<'_>, refined: Refined, depth: Vec<f32>, sigma: Vec<f32>) -> Surface {
    let status = scene.measurements.status;
    let maps = SurfaceMaps { depth, sigma, status, residual: refined.residual, ambient: refined.ambient };
    assemble(maps, scene.camera, &scene.rays.plane, &scene.white)
}
