//! Cameras of the USB3 Vision standard, with no vendor's software (crates `viva-u3v` and `viva-genapi`).
//!
//! A file imports only from above it here: `find`, `nodes`, `reader`; this one.

mod find;
mod nodes;
mod reader;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nelu3d_scan::image::Channels;
use viva_u3v::{NusbTransfer, U3vDevice, U3vStreamOptions, UsbTransfer, discover};

use self::nodes::Nodes;
use self::reader::Reader;
use crate::camera::Camera;
use crate::error::CaptureError;
use crate::frame::Frame;
use crate::genicam::fix::{CameraSettings, failure, prepare, start, stop};
use crate::genicam::frames::{PATIENCE, TICK, no_frame, not_read, saturation};
use crate::genicam::pixels::PixelFormat;

/// Longest time that a camera may take to stop what another program had started.
const SETTLES: Duration = Duration::from_secs(1);

/// A camera that streams frames over USB; `T` is what carries the bytes.
pub struct Usb3Camera<T: UsbTransfer + 'static = NusbTransfer> {
    reader: Reader,
    nodes: Nodes<T>,
    name: String,
    format: PixelFormat,
    clock: Instant,
    stop: Arc<AtomicBool>,
    delivered: u64,
    /// Frames with fewer bytes than their picture has.
    short: u64,
}

impl Usb3Camera {
    /// Connects to the camera with this serial number, or to the only one that is plugged in; fixes exposure, gain and
    /// white balance, and starts it. `stop` ends the waiting.
    ///
    /// # Errors
    ///
    /// No camera is plugged in, several are, it may not be opened or another program has it, it sets something by
    /// itself that cannot be fixed, or it has no pixel format that is read.
    pub fn connect(
        serial: Option<&str>,
        settings: &CameraSettings,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, CaptureError> {
        let found = discover().map_err(|e| {
            let remedy = "see that this computer has USB, and that no container hides it";
            failure(find::USB, &format!("cannot be searched ({e})"), remedy)
        })?;
        let info = find::choose(&found, serial)?;
        let device = U3vDevice::open_device(info)
            .map_err(|e| failure(&find::name(info), &format!("cannot be opened ({e})"), find::MAY_OPEN))?;
        Self::with_device(device, settings, stop)
    }
}

impl<T: UsbTransfer + 'static> Usb3Camera<T> {
    /// As [`Usb3Camera::connect`], for a device that is open, whatever carries its bytes.
    ///
    /// # Errors
    ///
    /// It does not describe its features, sets something by itself that cannot be fixed, has no pixel format that is
    /// read, or does not stream.
    pub fn with_device(
        mut device: U3vDevice<T>,
        settings: &CameraSettings,
        stopped: Arc<AtomicBool>,
    ) -> Result<Self, CaptureError> {
        let name = find::named(&device.abrm().serial_number, &device.abrm().model_name);
        let replug = "unplug it and plug it in again";
        let xml = device.fetch_xml().map_err(|e| failure(&name, &e, replug))?;
        let mut nodes = Nodes::new(&xml, device).map_err(|e| {
            failure(&name, &format!("describes its features wrongly ({e})"), "ask its maker for newer firmware")
        })?;
        // Nothing on USB tells a camera that its program was killed: it may still be streaming to that.
        stop(&mut nodes);
        nodes.wait_until_done("AcquisitionStop", SETTLES);
        let _ = nodes.device().stop_stream();
        let format = prepare(&mut nodes, settings, &name)?;
        let payload_size_hint = nodes.payload_size();
        let options = U3vStreamOptions { payload_size_hint, ..U3vStreamOptions::default() };
        let remedy = "see that no other program has it, and plug it into a port of USB 3";
        let stream = nodes.device().open_stream_with(&options).map_err(|e| failure(&name, &e, remedy))?;
        let reader = Reader::start(stream).map_err(|e| failure(&name, &e, "close other programs"))?;
        // Whole before it streams, so that it is stopped whatever fails from here on.
        let clock = Instant::now();
        let mut camera = Self { reader, nodes, name, format, clock, stop: stopped, delivered: 0, short: 0 };
        start(&mut camera.nodes).map_err(|e| failure(&camera.name, &e, remedy))?;
        Ok(camera)
    }

    /// Tells times of frames on this clock, the display's, from now on.
    #[must_use]
    pub fn with_clock(mut self, clock: Instant) -> Self {
        self.clock = clock;
        self
    }

    /// Returns how its sensor delivers color.
    pub fn channels(&self) -> Channels {
        self.format.channels()
    }

    /// Returns the largest code of its pixel format.
    pub fn saturation(&self) -> f64 {
        saturation(self.format)
    }
}

impl<T: UsbTransfer + 'static> Camera for Usb3Camera<T> {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let begun = Instant::now();
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CaptureError::Stopped);
            }
            if begun.elapsed() > PATIENCE {
                return Err(no_frame(&self.name, self.reader.incomplete() + self.short));
            }
            let arrived = self.reader.wait_for(TICK).map_err(|problem| {
                failure(&self.name, &problem, "see to its plug and cable, and start the capture again")
            })?;
            let Some(arrived) = arrived else { continue };
            let (leader, bytes) = (&arrived.frame.leader, &arrived.frame.payload);
            // A camera that changes its format by itself would change the meaning of the largest code, too.
            if !self.format.is(leader.pixel_format) {
                let format = format!("the pixel format {:#010x}, not {}", leader.pixel_format, self.format.name);
                return Err(not_read(&self.name, bytes.len(), &format));
            }
            let size = [leader.width as usize, leader.height as usize];
            let Some(raw) = self.format.picture(bytes, size, usize::from(leader.x_padding)) else {
                self.short += 1;
                continue;
            };
            let at = arrived.at.saturating_duration_since(self.clock);
            self.delivered += 1;
            return Ok(Frame { number: self.delivered - 1, at, raw });
        }
    }
}

impl<T: UsbTransfer + 'static> Drop for Usb3Camera<T> {
    fn drop(&mut self) {
        stop(&mut self.nodes);
        self.reader.stop();
        // A camera that is gone cannot be told.
        let _ = self.nodes.device().stop_stream();
    }
}

impl<T: UsbTransfer + 'static> std::fmt::Debug for Usb3Camera<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Usb3Camera").field("name", &self.name).field("format", &self.format).finish_non_exhaustive()
    }
}
