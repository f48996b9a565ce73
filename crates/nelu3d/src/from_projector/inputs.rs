//! The inputs of a color field from a calibrated projector: projected images, scenes, depth range.

use std::path::PathBuf;

use nelu3d_scan::image::read_any;
use nelu3d_scan::rig::{Capture, Need, PatternSet, Shot};
use nelu3d_scan::{Image, Projector, Rig};

use super::options::FromProjectorOptions;
use crate::calibrate::CalibrationError;
use crate::sensor::{NoiseEstimator, NoiseModel, darkest_intensity, quantization_step};

/// Largest number of scenes that blur and response are estimated from.
const MAX_SCENES: usize = 4;
/// Number of camera pixels beyond which two scenes are enough: blur and response are four numbers.
const MANY_PIXELS: usize = 2_000_000;

/// The error of something about the projector that is missing or does not fit.
pub(super) fn projector_error(path: PathBuf, reason: impl Into<String>) -> CalibrationError {
    CalibrationError::Projector { path, reason: reason.into() }
}

/// Returns the rig's calibrated projector.
pub(super) fn calibrated_projector(rig: &Rig) -> Result<&Projector, CalibrationError> {
    let missing = "is missing; a field from a projector needs a calibrated one, any other rig a board sweep";
    rig.projector.as_ref().ok_or_else(|| projector_error(rig.root.join("projector.json"), missing))
}

/// Reads the projected images of a set, one plane per channel of the camera; a gray pattern serves all of them. A
/// pattern that changes along one axis alone is reduced to one row or column, of which all others are copies.
pub(super) fn read_patterns(
    rig: &Rig,
    set: &PatternSet,
    projector: &Projector,
) -> Result<Vec<Image>, CalibrationError> {
    let (w, h) = (projector.optics.width, projector.optics.height);
    let mut patterns = Vec::new();
    for name in &set.images {
        let path = rig.root.join("patterns").join(name);
        let image = read_any(&path).map_err(|e| projector_error(path.clone(), e.to_string()))?;
        if (image.width, image.height) != (w, h) {
            let reason = format!("is {} × {} px, but projector.json says {w} × {h}", image.width, image.height);
            return Err(projector_error(path, reason));
        }
        for c in 0..rig.channels.count() {
            let data = image.data.chunks_exact(image.channels).map(|p| p[c.min(p.len() - 1)]).collect();
            patterns.push(reduced(Image { width: w, height: h, channels: 1, data }));
        }
    }
    Ok(patterns)
}

/// Returns a pattern's single row or column, of which all others are copies; the pattern itself where they are not.
pub fn reduced(pattern: Image) -> Image {
    let w = pattern.width;
    if pattern.data.chunks_exact(w).all(|row| row == &pattern.data[..w]) {
        return Image { height: 1, data: pattern.data[..w].to_vec(), ..pattern };
    }
    if pattern.data.chunks_exact(w).all(|row| row.iter().all(|v| *v == row[0])) {
        return Image { width: 1, data: pattern.data.iter().step_by(w).copied().collect(), ..pattern };
    }
    pattern
}

/// Finds the scenes whose captures tell blur and response: the first four that have the set's images, two of large
/// pictures.
pub(super) fn find_scenes(rig: &Rig, set: &PatternSet) -> Result<Vec<Shot>, CalibrationError> {
    let number = (MANY_PIXELS / (rig.camera.width * rig.camera.height).max(1)).clamp(2, MAX_SCENES);
    let has_all = |s: &Shot| set.images.iter().chain([&rig.white]).all(|n| rig.has_image(&s.dir.join(n)));
    let found: Vec<Shot> = rig.scenes()?.into_iter().filter(has_all).take(number).collect();
    if found.is_empty() {
        let reason = format!(
            "holds no scene with the images of set `{}`, from which the projector's blur and response are estimated \
             where no sweep tells them; capture one",
            set.name
        );
        return Err(projector_error(rig.root.join("scenes"), reason));
    }
    Ok(found)
}

/// Reads the captures of scenes, and estimates the sensor's noise from them.
pub(super) fn read_captures(
    rig: &Rig,
    set: &PatternSet,
    scenes: &[Shot],
) -> Result<(Vec<Capture>, NoiseModel), CalibrationError> {
    let mut sensor = NoiseEstimator::default();
    let darkest = darkest_intensity(rig.black_level, rig.saturation);
    let mut captures = Vec::new();
    for shot in scenes {
        let capture = rig.read_shot(shot, set, Need::Scene)?;
        sensor.add(&capture.white);
        capture.patterns.iter().for_each(|p| sensor.add(p));
        captures.push(capture);
    }
    let noise = sensor.finish(quantization_step(rig.black_level, rig.saturation), Some(darkest));
    Ok((captures, noise))
}

/// Returns `[near, far]` depth, mm, as given.
pub(super) fn given_depth(rig: &Rig, opts: &FromProjectorOptions) -> Result<Option<[f64; 2]>, CalibrationError> {
    match opts.depth.as_deref() {
        None => Ok(None),
        Some(&[near, far]) if near > 0.0 && far > near && far.is_finite() => Ok(Some([near, far])),
        Some(_) => {
            let reason = "a depth range needs two distances in mm, the near one above 0 and below the far one";
            Err(projector_error(rig.root.clone(), reason))
        }
    }
}
