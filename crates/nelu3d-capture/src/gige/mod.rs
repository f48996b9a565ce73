//! Cameras of the GigE Vision standard, over the network, with no vendor's software (crate `telegenic`).

mod pixels;

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use nelu3d_scan::image::Channels;
use telegenic::gige::GigeConfig;
use telegenic::gige::discovery::{DiscoveryConfig, discover};
use telegenic::{FrameChannel, FrameStatus, GenICamera, GenicamError, StreamChannel, StreamConfig};

use self::pixels::{FORMATS, PixelFormat};
use crate::camera::Camera;
use crate::error::CaptureError;
use crate::frame::Frame;

/// Longest time without a frame.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time between two looks at whether to stop.
const TICK: Duration = Duration::from_millis(100);
/// Frames that wait here while one is looked at; older ones would be late.
const WAITING: usize = 3;
/// Largest difference between a number that was asked for and what the camera made of it, of it.
const MAX_OFF: f64 = 0.1;

/// What a camera is asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GigeSettings {
    /// Exposure time, microseconds; none: as it is.
    pub exposure_us: Option<f64>,
    /// Gain, in the camera's own unit (decibels, mostly); none: as it is.
    pub gain: Option<f64>,
}

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
        settings: &GigeSettings,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, CaptureError> {
        let address = match address {
            Some(address) => address,
            None => find()?,
        };
        Self::start(GigeConfig::new(address), settings, stop)
    }

    /// As [`GigeCamera::connect`], at any port of any address.
    ///
    /// # Errors
    ///
    /// As [`GigeCamera::connect`].
    pub fn connect_at(
        address: SocketAddr,
        settings: &GigeSettings,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, CaptureError> {
        let config = GigeConfig { addr: address, ..GigeConfig::new(address.ip()) };
        Self::start(config, settings, stop)
    }

    fn start(config: GigeConfig, settings: &GigeSettings, stop: Arc<AtomicBool>) -> Result<Self, CaptureError> {
        let device = format!("the camera at {}", config.addr.ip());
        let fails = |e: GenicamError, remedy: &str| failure(&device, &e, remedy);
        let mut camera = GenICamera::with_config(config);
        camera.connect().map_err(|e| {
            fails(e, "see that it has power and is in this computer's network, and that no other program has it")
        })?;
        let format = choose_format(&mut camera).map_err(|e| fails(e, "unplug it and plug it in again"))?;
        let Some(format) = format else {
            let entries = camera.enum_entries("PixelFormat").unwrap_or_default().join(", ");
            return Err(CaptureError::Device {
                device,
                problem: format!("has no pixel format that is read ({entries})"),
                remedy: "set it to Mono8, Mono12 or BayerRG12 in its own program".into(),
            });
        };
        fix(&mut camera, settings, &device)?;
        if camera.has_feature("AcquisitionMode") {
            camera.set_enum("AcquisitionMode", "Continuous").map_err(|e| fails(e, "see whether it can stream"))?;
        }
        let remedy = "see that no firewall stands between this computer and the camera";
        let payload = camera.get_integer("PayloadSize").map_err(|e| fails(e, remedy))?;
        let stream = StreamConfig { payload_size: usize::try_from(payload).ok(), ..StreamConfig::new() };
        let stream = camera.transport().open_stream(stream).map_err(|e| fails(e.into(), remedy))?;
        let frames = stream.subscribe(WAITING);
        if camera.has_feature("TLParamsLocked") {
            camera.set_integer("TLParamsLocked", 1).map_err(|e| fails(e, remedy))?;
        }
        camera.execute("AcquisitionStart").map_err(|e| fails(e, remedy))?;
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
        f64::from((1u32 << self.format.bits) - 1)
    }
}

impl Camera for GigeCamera {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let begun = Instant::now();
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CaptureError::Stopped);
            }
            let fails = |problem: String, remedy: &str| CaptureError::Device {
                device: self.name.clone(),
                problem,
                remedy: remedy.into(),
            };
            if begun.elapsed() > PATIENCE || !self.camera.is_connected() {
                let stats = self.stream.as_ref().map(StreamChannel::stats).unwrap_or_default();
                let problem = if stats.failed_frames > 0 {
                    format!("delivers no whole frame ({} incomplete)", stats.failed_frames)
                } else {
                    "delivers no frame".into()
                };
                return Err(fails(problem, "see to its cable and that it is not set to wait for a trigger"));
            }
            // Frames with holes are as lost as those that never came.
            let Some(frame) = self.frames.wait_for(TICK).filter(|f| f.status == FrameStatus::Complete) else {
                continue;
            };
            let at = arrival(self.clock, frame.system_timestamp_ns);
            let size = [frame.width as usize, frame.height as usize];
            let format = PixelFormat::of(frame.pixel_format.0);
            let Some(raw) = format.and_then(|f| f.picture(frame.data(), size, usize::from(frame.x_padding))) else {
                let problem = format!("delivered {} bytes of {}", frame.data().len(), frame.pixel_format);
                return Err(fails(problem, "set its pixel format to Mono8, Mono12 or BayerRG12"));
            };
            self.delivered += 1;
            return Ok(Frame { number: self.delivered - 1, at, raw });
        }
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        // A camera that is gone cannot be told.
        let _ = self.camera.execute("AcquisitionStop");
        if self.camera.has_feature("TLParamsLocked") {
            let _ = self.camera.set_integer("TLParamsLocked", 0);
        }
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

/// Sets the format of most bits that the camera has and that is read; of those of 16 bits only where there is none of
/// the sensor's own.
fn choose_format(camera: &mut GenICamera) -> Result<Option<PixelFormat>, GenicamError> {
    let entries = camera.enum_entries("PixelFormat")?;
    let has = |f: &&PixelFormat| entries.iter().any(|e| e == f.name);
    // What is 16 bits is mostly fewer, shifted or not: the largest code is then not known.
    let own = FORMATS.iter().filter(|f| f.bits < 16).filter(has);
    for format in own.chain(FORMATS.iter().filter(|f| f.bits == 16).filter(has)) {
        if camera.set_enum("PixelFormat", format.name).is_ok() {
            return Ok(Some(*format));
        }
    }
    Ok(None)
}

/// Fixes what a camera may change by itself, and makes its codes linear; checks that it took it.
fn fix(camera: &mut GenICamera, settings: &GigeSettings, device: &str) -> Result<(), CaptureError> {
    let unfixed = |feature: &str, problem: String| CaptureError::Device {
        device: device.into(),
        problem: format!("{feature} {problem}"),
        remedy: "fix it in the camera's own program".into(),
    };
    for feature in ["ExposureAuto", "GainAuto", "BalanceWhiteAuto"] {
        if camera.has_feature(feature) {
            // Some have the feature and no access to it: what they say counts.
            let _ = camera.set_enum(feature, "Off");
            match camera.get_enum(feature) {
                Ok(now) if now == "Off" => {}
                Ok(now) => return Err(unfixed(feature, format!("stays {now}"))),
                Err(GenicamError::Access(_)) => {}
                Err(e) => return Err(unfixed(feature, format!("cannot be read ({e})"))),
            }
        }
    }
    if camera.has_feature("TriggerMode") {
        let _ = camera.set_enum("TriggerMode", "Off");
    }
    if camera.has_feature("GammaEnable") {
        let _ = camera.set_boolean("GammaEnable", false);
    } else if camera.has_feature("Gamma") {
        let _ = camera.set_float("Gamma", 1.0);
    }
    let numbers = [(["ExposureTime", "ExposureTimeAbs"], settings.exposure_us), (["Gain", "GainAbs"], settings.gain)];
    for (names, wanted) in numbers {
        let Some(wanted) = wanted else { continue };
        let name = names
            .into_iter()
            .find(|n| camera.has_feature(n))
            .ok_or_else(|| unfixed(names[0], "is none of its features, and was asked for".into()))?;
        camera.set_float(name, wanted).map_err(|e| unfixed(name, format!("cannot be {wanted} ({e})")))?;
        let now = camera.get_float(name).map_err(|e| unfixed(name, format!("cannot be read ({e})")))?;
        if (now - wanted).abs() > MAX_OFF * wanted.abs().max(1.0) {
            return Err(unfixed(name, format!("became {now}, not {wanted}")));
        }
    }
    Ok(())
}

fn failure(device: &str, e: &dyn std::fmt::Display, remedy: &str) -> CaptureError {
    CaptureError::Device { device: device.into(), problem: e.to_string(), remedy: remedy.into() }
}
