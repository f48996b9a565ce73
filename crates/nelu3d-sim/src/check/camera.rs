//! Checks of the camera.

use nelu3d_scan::rig::Channels;

use super::rules::{Optics, check, finite, optics, within};
use crate::spec::{CameraSpec, PerColor, SpecError};

/// Checks the camera.
pub(super) fn check_camera(c: &CameraSpec) -> Result<(), SpecError> {
    let intrinsics = [c.fx, c.fy, c.cx, c.cy];
    let distortion = c.optics().is_some();
    optics(&Optics { key: "camera", size: [c.width, c.height], intrinsics, distortion })?;
    let known = Channels::ALL.map(Channels::name).join(", ");
    check(c.channels().is_some(), "camera.channels", &c.channels, &format!("it must be one of: {known}"))?;
    within("camera.bits", f64::from(c.bits), 1.0, 16.0)?;
    let good = c.black_level >= 0.0 && c.black_level < c.saturation();
    check(good, "camera.black_level", c.black_level, "it must be 0 or more, and below the largest code")?;
    within("camera.full_well_electrons", c.full_well_electrons, 1.0, 1e9)?;
    within("camera.read_noise_electrons", c.read_noise_electrons, 0.0, 1e6)?;
    within("camera.psf_sigma_px", c.psf_sigma_px, 0.0, 20.0)?;
    within("camera.gain", c.gain, 1.0, 1e4)?;
    let rates = c.electrons_per_sec;
    for rate in rates.rgb() {
        let good = rate > 0.0 && rate <= 1e15;
        check(good, "camera.electrons_per_sec", rate, "give a number above 0, up to 1e15")?;
    }
    let one = matches!(rates, PerColor::Same(_)) || c.channels() != Some(Channels::Mono);
    check(
        one,
        "camera.electrons_per_sec",
        format!("{:?}", rates.rgb()),
        "a mono camera has one channel: give one number",
    )?;
    let good = c.exposure_secs > 0.0 && c.exposure_secs <= 3600.0;
    check(good, "camera.exposure_secs", c.exposure_secs, "give seconds above 0, up to 3600")?;
    within("camera.dark_electrons_per_sec", c.dark_electrons_per_sec, 0.0, 1e9)?;
    within("camera.shutter_samples", c.shutter_samples as f64, 1.0, 64.0)?;
    within("camera.vignetting", c.vignetting, 0.0, 100.0)?;
    check(
        c.mono_images.is_empty() || c.channels() == Some(Channels::Rgb),
        "camera.mono_images",
        c.mono_images.join(", "),
        "only a camera with channels = \"rgb\" has another mode for them",
    )?;
    finite("camera.color_mixing", c.color_mixing.as_flattened())
}
