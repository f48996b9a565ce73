//! Cameras of the GigE Vision standard, over the network, with no vendor's software (crate `telegenic`).

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use nelu3d_scan::image::Channels;
use telegenic::gige::GigeConfig;
use telegenic::gige::discovery::{DiscoveryConfig, discover};
use telegenic::{FrameChannel, FrameStatus, GenICamera, GenicamError, StreamChannel, StreamConfig};

use super::features::{FeatureError, Features};
use super::fix::{CameraSettings, failure, prepare, start, stop};
use super::frames::{PATIENCE, TICK, WAITING, no_frame, not_read, saturation};
use super::pixels::PixelFormat;
use crate::camera::Camera;
use crate::error::CaptureError;
use crate::frame::Frame;

/// A camera that streams frames.
pub struct GigeCamera {
    // Closed before the camera is let go.
    stream: Option<StreamChannel>,
    frames: FrameChannel,
    camera: GenICamera,
    name: String,
    format: PixelFormat,
    clock: Instant,
    stop: Arc<AtomicBool>,
    delivered: u64,
}

impl GigeCamera {
    /// Connects to the camera at this address, or to the only one that answers in the networks of this computer; fixes
    /// exposure, gain and white balance, and starts it. `stop` ends the waiting.
    ///
    /// # Errors
    ///
    /// No camera answers, several do, another program has it, it sets something by itself that cannot be fixed, or it
    /// has no pixel format that is read.
    pub fn connect(
        address: Option<IpAddr>,
        settings: &CameraSettings,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, CaptureError> {
        let address = match address {
            Some(address) => address,
            None => find()?,
        };
        Self::open(GigeConfig::new(address), settings, stop)
    }

    /// As [`GigeCamera::connect`], at any port of any address.
    ///
    /// # Errors
    ///
    /// As [`GigeCamera::connect`].
    pub fn connect_at(
        address: SocketAddr,
        settings: &CameraSettings,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, CaptureError> {
        let config = GigeConfig { addr: address, ..GigeConfig::new(address.ip()) };
        Self::open(config, settings, stop)
    }

    fn open(config: GigeConfig, settings: &CameraSettings, stop: Arc<AtomicBool>) -> Result<Self, CaptureError> {
        let device = format!("the camera at {}", config.addr.ip());
        let fails = |e: GenicamError, remedy: &str| failure(&device, &e, remedy);
        let mut camera = GenICamera::with_config(config);
        camera.connect().map_err(|e| {
            fails(e, "see that it has power and is in this computer's network, and that no other program has it")
        })?;
        let format = prepare(&mut camera, settings, &device)?;
        let remedy = "see that no firewall stands between this computer and the camera";
        let payload = camera.get_integer("PayloadSize").map_err(|e| fails(e, remedy))?;
        let stream = StreamConfig { payload_size: usize::try_from(payload).ok(), ..StreamConfig::new() };
        let stream = camera.transport().open_stream(stream).map_err(|e| fails(e.into(), remedy))?;
        let frames = stream.subscribe(WAITING);
        start(&mut camera).map_err(|e| failure(&device, &e, remedy))?;
        Ok(Self {
            stream: Some(stream),
            frames,
            camera,
            name: device,
            format,
            clock: Instant::now(),
            stop,
            delivered: 0,
        })
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

impl Camera for GigeCamera {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let begun = Instant::now();
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CaptureError::Stopped);
            }
            if begun.elapsed() > PATIENCE || !self.camera.is_connected() {
                let stats = self.stream.as_ref().map(StreamChannel::stats).unwrap_or_default();
                return Err(no_frame(&self.name, stats.failed_frames));
            }
            // Frames with holes are as lost as those that never came.
            let Some(frame) = self.frames.wait_for(TICK).filter(|f| f.status == FrameStatus::Complete) else {
                continue;
            };
            let at = arrival(self.clock, frame.system_timestamp_ns);
            let size = [frame.width as usize, frame.height as usize];
            let format = PixelFormat::of(frame.pixel_format.0);
            let Some(raw) = format.and_then(|f| f.picture(frame.data(), size, usize::from(frame.x_padding))) else {
                return Err(not_read(&self.name, frame.data().len(), &frame.pixel_format));
            };
            self.delivered += 1;
            return Ok(Frame { number: self.delivered - 1, at, raw });
        }
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        stop(&mut self.camera);
        self.stream = None;
    }
}

impl std::fmt::Debug for GigeCamera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GigeCamera").field("name", &self.name).field("format", &self.format).finish_non_exhaustive()
    }
}

/// Returns when a frame began to arrive, on the display's clock, from the system's time of then.
fn arrival(clock: Instant, system_ns: u64) -> Duration {
    let now = clock.elapsed();
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH + Duration::from_nanos(system_ns));
    // The system's clock may have been set meanwhile: a frame does not wait for long.
    now.saturating_sub(since.ok().filter(|waited| *waited < Duration::from_secs(5)).unwrap_or_default())
}

/// Returns the address of the only camera in the networks of this computer.
fn find() -> Result<IpAddr, CaptureError> {
    let device = || "the network".to_owned();
    let found = discover(&DiscoveryConfig::default()).map_err(|e| failure(&device(), &e, "give its address"))?;
    match found.as_slice() {
        [one] => Ok(telegenic::gige::discovery::device_ip(one)),
        [] => Err(CaptureError::Device {
            device: device(),
            problem: "has no GigE Vision camera that answers".into(),
            remedy: "give its address, and see that it has power and an address in this computer's network".into(),
        }),
        several => {
            let all: Vec<String> = several.iter().map(|d| format!("{} ({})", d.from.ip(), d.info.model)).collect();
            Err(CaptureError::Device {
                device: device(),
                problem: format!("has several cameras: {}", all.join(", ")),
                remedy: "give the address of one of them".into(),
            })
        }
    }
}

impl From<GenicamError> for FeatureError {
    fn from(e: GenicamError) -> Self {
        Self { no_access: matches!(e, GenicamError::Access(_)), text: e.to_string() }
    }
}

impl Features for GenICamera {
    fn has(&self, name: &str) -> bool {
        self.has_feature(name)
    }

    fn entries(&mut self, name: &str) -> Result<Vec<String>, FeatureError> {
        Ok(self.enum_entries(name)?)
    }

    fn entry(&mut self, name: &str) -> Result<String, FeatureError> {
        Ok(self.get_enum(name)?)
    }

    fn choose(&mut self, name: &str, entry: &str) -> Result<(), FeatureError> {
        Ok(self.set_enum(name, entry)?)
    }

    fn switch(&mut self, name: &str, on: bool) -> Result<(), FeatureError> {
        Ok(self.set_boolean(name, on)?)
    }

    fn number(&mut self, name: &str) -> Result<f64, FeatureError> {
        Ok(self.get_float(name)?)
    }

    fn set_number(&mut self, name: &str, value: f64) -> Result<(), FeatureError> {
        Ok(self.set_float(name, value)?)
    }

    fn set_integer(&mut self, name: &str, value: i64) -> Result<(), FeatureError> {
        Ok(GenICamera::set_integer(self, name, value)?)
    }

    fn run(&mut self, name: &str) -> Result<(), FeatureError> {
        Ok(self.execute(name)?)
    }
}
