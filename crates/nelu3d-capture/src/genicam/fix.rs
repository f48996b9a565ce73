//! What is the same for every such camera before it streams and after: its pixels, its exposure, and that nothing
//! changes by itself.

use super::features::{FeatureError, Features};
use super::pixels::{FORMATS, PixelFormat};
use crate::error::CaptureError;

/// Largest difference between a number that was asked for and what the camera made of it, of it.
const MAX_OFF: f64 = 0.1;

/// What a camera is asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraSettings {
    /// Exposure time, microseconds; none: as it is.
    pub exposure_us: Option<f64>,
    /// Gain, in the camera's own unit (decibels, mostly); none: as it is.
    pub gain: Option<f64>,
}

/// Chooses the pixel format, fixes what a camera may change by itself, makes its codes linear, and sets exposure and
/// gain; returns the format.
///
/// # Errors
///
/// Names `device`: it has no format that is read, something stays automatic, or it did not take a number.
pub(super) fn prepare(
    camera: &mut dyn Features,
    settings: &CameraSettings,
    device: &str,
) -> Result<PixelFormat, CaptureError> {
    let Some(format) = choose_format(camera).map_err(|e| failure(device, &e, "unplug it and plug it in again"))? else {
        let entries = camera.entries("PixelFormat").unwrap_or_default().join(", ");
        return Err(CaptureError::Device {
            device: device.into(),
            problem: format!("has no pixel format that is read ({entries})"),
            remedy: "set it to Mono8, Mono12 or BayerRG12 in its own program".into(),
        });
    };
    fix(camera, settings, device)?;
    if camera.has("AcquisitionMode") {
        let fails = |e| failure(device, &e, "see whether it can stream");
        camera.choose("AcquisitionMode", "Continuous").map_err(fails)?;
    }
    Ok(format)
}

/// Locks what must not change in a stream, and starts it.
pub(super) fn start(camera: &mut dyn Features) -> Result<(), FeatureError> {
    if camera.has("TLParamsLocked") {
        camera.set_integer("TLParamsLocked", 1)?;
    }
    camera.run("AcquisitionStart")
}

/// Stops the stream and unlocks what it locked. A camera that is gone or does not stream cannot be told, and need not.
pub(super) fn stop(camera: &mut dyn Features) {
    let _ = camera.run("AcquisitionStop");
    if camera.has("TLParamsLocked") {
        let _ = camera.set_integer("TLParamsLocked", 0);
    }
}

/// Returns the error that `device` has a problem, and what to do.
pub(super) fn failure(device: &str, problem: &dyn std::fmt::Display, remedy: &str) -> CaptureError {
    CaptureError::Device { device: device.into(), problem: problem.to_string(), remedy: remedy.into() }
}

/// Sets the format of most bits that the camera has and that is read; of those of 16 bits only where there is none of
/// the sensor's own.
fn choose_format(camera: &mut dyn Features) -> Result<Option<PixelFormat>, FeatureError> {
    let entries = camera.entries("PixelFormat")?;
    let has = |f: &&PixelFormat| entries.iter().any(|e| e == f.name);
    // What is 16 bits is mostly fewer, shifted or not: the largest code is then not known.
    let own = FORMATS.iter().filter(|f| f.bits < 16).filter(has);
    for format in own.chain(FORMATS.iter().filter(|f| f.bits == 16).filter(has)) {
        if camera.choose("PixelFormat", format.name).is_ok() {
            return Ok(Some(*format));
        }
    }
    Ok(None)
}

/// Fixes what a camera may change by itself, and makes its codes linear; checks that it took it.
fn fix(camera: &mut dyn Features, settings: &CameraSettings, device: &str) -> Result<(), CaptureError> {
    let unfixed = |feature: &str, problem: String| CaptureError::Device {
        device: device.into(),
        problem: format!("{feature} {problem}"),
        remedy: "fix it in the camera's own program".into(),
    };
    for feature in ["ExposureAuto", "GainAuto", "BalanceWhiteAuto"] {
        if camera.has(feature) {
            // Some have the feature and no access to it: what they say counts.
            let _ = camera.choose(feature, "Off");
            match camera.entry(feature) {
                Ok(now) if now == "Off" => {}
                Ok(now) => return Err(unfixed(feature, format!("stays {now}"))),
                Err(e) if e.no_access => {}
                Err(e) => return Err(unfixed(feature, format!("cannot be read ({e})"))),
            }
        }
    }
    if camera.has("TriggerMode") {
        let _ = camera.choose("TriggerMode", "Off");
    }
    if camera.has("GammaEnable") {
        let _ = camera.switch("GammaEnable", false);
    } else if camera.has("Gamma") {
        let _ = camera.set_number("Gamma", 1.0);
    }
    let numbers = [(["ExposureTime", "ExposureTimeAbs"], settings.exposure_us), (["Gain", "GainAbs"], settings.gain)];
    for (names, wanted) in numbers {
        let Some(wanted) = wanted else { continue };
        let name = names
            .into_iter()
            .find(|n| camera.has(n))
            .ok_or_else(|| unfixed(names[0], "is none of its features, and was asked for".into()))?;
        camera.set_number(name, wanted).map_err(|e| unfixed(name, format!("cannot be {wanted} ({e})")))?;
        let now = camera.number(name).map_err(|e| unfixed(name, format!("cannot be read ({e})")))?;
        if (now - wanted).abs() > MAX_OFF * wanted.abs().max(1.0) {
            return Err(unfixed(name, format!("became {now}, not {wanted}")));
        }
    }
    Ok(())
}
