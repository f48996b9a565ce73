//! Cameras that the program drives itself: those of GigE Vision and USB3 Vision, where it was built with them.

use std::time::Instant;

use anyhow::Result;
use nelu3d_capture::Camera;
#[cfg(any(feature = "gige", feature = "usb3"))]
use nelu3d_capture::CameraSettings;
#[cfg(feature = "gige")]
use nelu3d_capture::GigeCamera;
#[cfg(feature = "usb3")]
use nelu3d_capture::Usb3Camera;
use nelu3d_scan::image::Channels;

use crate::args::CaptureArgs;
use crate::context::CommandContext;

/// Color format of a camera's pictures and its largest code.
pub(super) type Sensor = (Channels, f64);

/// Returns a camera whose frames' times are told on a clock, the display's.
pub(super) type OnClock = Box<dyn FnOnce(Instant) -> Box<dyn Camera>>;

/// Connects to the camera that was asked for; none if it is not one of these.
pub(super) fn connect(args: &CaptureArgs, context: &CommandContext) -> Result<Option<(Sensor, OnClock)>> {
    #[cfg(feature = "gige")]
    if let Some(address) = args.gige {
        let camera = GigeCamera::connect(address.0, &settings(args), context.cancel())?;
        let sensor = (camera.channels(), camera.saturation());
        return Ok(Some((sensor, Box::new(|clock| Box::new(camera.with_clock(clock))))));
    }
    #[cfg(feature = "usb3")]
    if let Some(serial) = args.usb3.as_deref() {
        let serial = Some(serial).filter(|s| *s != "auto");
        let camera = Usb3Camera::connect(serial, &settings(args), context.cancel())?;
        let sensor = (camera.channels(), camera.saturation());
        return Ok(Some((sensor, Box::new(|clock| Box::new(camera.with_clock(clock))))));
    }
    let _ = (args, context);
    Ok(None)
}

#[cfg(any(feature = "gige", feature = "usb3"))]
fn settings(args: &CaptureArgs) -> CameraSettings {
    CameraSettings { exposure_us: args.exposure_us, gain: args.gain }
}
