//! A color field without a sweep, from a calibrated projector and the images that it projected.
//!
//! c(x) is then the pattern at the projector pixel that lights x, through the projector's optics (a blur) and its
//! response (a curve). Neither is in any calibration file, so both are estimated: from the boards of a sweep, where
//! there is one, whose points are known; else from scenes: decode with what is known, compare the captures with the
//! patterns where they were found to come from, and repeat. What few patterns say of a scene can be explained by a
//! wrong response and wrong depths together.

mod displaced;
mod fit;
mod geometry;
#[doc(hidden)]
pub mod inputs;
mod options;
mod render;
#[doc(hidden)]
pub mod response;
mod source;

use nelu3d_scan::Rig;
use nelu3d_scan::rig::PatternSet;

use crate::calibrate::{CalibrationError, CalibrationReport};
use crate::color_field::frame::Center;
use crate::color_field::{ColorField, FieldMetadata, ProjectorResidual, camera_key};
use crate::progress::{Progress, StageClock};
use crate::sensor::NoiseModel;
use crate::verdict::Judgment;
use displaced::Displaced;
use fit::{Fitted, ResponseFit};
use geometry::Volume;
pub use geometry::crossing_depth;
use inputs::{calibrated_projector, given_depth, projector_error, read_patterns};
pub use options::FromProjectorOptions;
use response::Residual;
use source::{Evidence, Source};

/// Computes a color field from the calibrated projector, its projected images, and the boards of a sweep or, where
/// there is none that can be used, the captures of up to four scenes, which tell its blur and response.
///
/// # Errors
///
/// The projector or a projected image is missing or does not fit, an image cannot be read, there is neither a sweep nor
/// a scene that could be decoded, or the caller stopped the work.
pub fn calibrate_from_projector(
    rig: &Rig,
    set: &PatternSet,
    opts: &FromProjectorOptions,
    progress: &Progress,
) -> Result<(ColorField, CalibrationReport), CalibrationError> {
    let mut clock = StageClock::new(progress);
    clock.begin("read the patterns");
    let projector = calibrated_projector(rig)?;
    let patterns = read_patterns(rig, set, projector)?;
    let given_mm = given_depth(rig, opts)?;
    let Evidence { source, noise, dark, blur, boards, bend } = Evidence::find(rig, set, progress, &mut clock)?;

    clock.begin("estimate blur and response");
    let metadata = FieldMetadata { dark, blur, boards, board_bend: bend, ..metadata(rig, set, noise) };
    let fit = ResponseFit { rig, projector, patterns, metadata };
    let (depth_mm, fitted) = fit.fit(&source, given_mm, progress)?.ok_or_else(|| {
        let reason = "no scene could be decoded, so blur and response stay unknown; check the projector's calibration, \
                      or give a depth range";
        projector_error(rig.root.join("scenes"), reason)
    })?;
    let Fitted { residual: Residual { median: residual, rms }, noise_sigma, response, .. } = fitted;
    let volume = Volume::new(&rig.camera, projector, depth_mm).ok_or_else(|| no_overlap(rig, depth_mm))?;
    let mut field = fit.field(response, volume);
    field.metadata.settings = serde_json::json!({
        "options": opts, "response": response, "residual": residual, "depth_mm": depth_mm,
    });
    let displaced = match &source {
        Source::Boards { codewords, at, .. } => Displaced::of(&field, codewords, at),
        Source::Scenes(_) => None,
    };
    let pose_covariance = displaced.as_ref().map(|d| d.covariance);
    field.metadata.residual = Some(ProjectorResidual { sigma: rms, noise_sigma, pose_covariance });
    let center = projector.center();
    let mut judgment = Judgment::default();
    judgment.extend(source.unsure(&fit.patterns, response));
    judgment.extend(displaced.and_then(|d| d.finding()));
    field.metadata.warnings = judgment.warnings.iter().map(|w| w.code.name()).collect();
    let report = CalibrationReport {
        judgment,
        boards_mm: None,
        corner_rms_px: None,
        trajectory: None,
        light_mm: Some([center.x, center.y, center.z]),
        quality: None,
        frame: format!(
            "light: the calibrated projector, blur {:.2} px, response {:.3} + {:.3} v^{:.2} from {source}, \
             median residual {residual:.3}",
            response.blur_px, response.offset, response.scale, response.gamma
        ),
        shortfall: None,
        excluded: Vec::new(),
        refined_poses: None,
        carried: None,
        cells: field.to_grid().cells,
        stages: clock.finish(),
    };
    Ok((field, report))
}

/// The error of light and view that do not overlap.
fn no_overlap(rig: &Rig, [near, far]: [f64; 2]) -> CalibrationError {
    let reason = format!(
        "its light and the camera's view do not overlap between {near:.0} and {far:.0} mm; check R and T, or give a \
         depth range"
    );
    projector_error(rig.root.join("projector.json"), reason)
}

/// Returns the metadata of the field, as far as they are known before blur and response.
fn metadata(rig: &Rig, set: &PatternSet, noise: NoiseModel) -> FieldMetadata {
    FieldMetadata {
        version: env!("CARGO_PKG_VERSION").into(),
        rig: rig.name.clone(),
        set: set.name.clone(),
        images: set.images.clone(),
        mono: Vec::new(),
        channels: rig.channels.count(),
        center: Center::Light,
        source: "projector".into(),
        camera: camera_key(&rig.camera),
        noise,
        blur: None,
        dark: Vec::new(),
        crosstalk: None,
        cells_per_pixel: 1,
        step_mm: 0.0,
        quality: None,
        residual: None,
        warnings: Vec::new(),
        boards: Vec::new(),
        board_bend: None,
        corrected: Vec::new(),
        settings: serde_json::Value::Null,
    }
}
