//! Arguments of `capture`.

use std::path::PathBuf;

use nelu3d_scan::image::Channels;

use super::{parse_channels, parse_code, parse_size};

/// Arguments of `nelu3d capture`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("source").required(true))]
pub(crate) struct CaptureArgs {
    /// Rig folder, new or begun by an earlier capture.
    pub rig: PathBuf,
    /// The camera is a webcam: the page in the browser looks through it.
    #[arg(long, group = "source")]
    pub webcam: bool,
    /// The camera takes a picture when this is run, as "gphoto2 … --filename {file}".
    #[arg(long, value_name = "COMMAND", group = "source")]
    pub camera_command: Option<String>,
    /// The camera's own program saves its pictures in this folder.
    #[arg(long, value_name = "DIR", group = "source")]
    pub watch: Option<PathBuf>,
    /// A GigE Vision camera at this address in the network; "auto": the only one that answers.
    #[cfg(feature = "gige")]
    #[arg(long, value_name = "IP|auto", groups = ["source", "settable"], value_parser = gige_address)]
    pub gige: Option<GigeAddress>,
    /// A USB3 Vision camera with this serial number; "auto": the only one that is plugged in.
    #[cfg(feature = "usb3")]
    #[arg(long, value_name = "SERIAL|auto", groups = ["source", "settable"])]
    pub usb3: Option<String>,
    /// Exposure time of a GigE Vision or USB3 Vision camera, microseconds (default: as it is set).
    #[cfg(any(feature = "gige", feature = "usb3"))]
    #[arg(long, value_name = "US", requires = "settable")]
    pub exposure_us: Option<f64>,
    /// Gain of a GigE Vision or USB3 Vision camera, in its own unit (default: as it is set).
    #[cfg(any(feature = "gige", feature = "usb3"))]
    #[arg(long, value_name = "GAIN", requires = "settable")]
    pub gain: Option<f64>,
    /// No hardware: a simulated display and camera, late and unreliable, show this rig's images.
    #[arg(long, value_name = "RIG", group = "source")]
    pub rehearse: Option<PathBuf>,
    /// Take this scene at once, without waiting for somebody to press a button, and end; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub scene: Vec<String>,
    /// How the camera's codes follow light: linear or srgb, for a new rig (default: srgb for a webcam, linear otherwise);
    /// or measure it, before anything else, on whatever stands still in the projector's light.
    #[arg(long, value_name = "linear|srgb|measure", value_parser = ["linear", "srgb", "measure"])]
    pub response: Option<String>,
    /// Port of the page on 127.0.0.1 (default: any that is free).
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port: u16,
    /// Settings of a new rig.
    #[command(flatten)]
    pub new: NewRigArgs,
}

impl CaptureArgs {
    /// Returns whether the response is to be measured.
    pub(crate) fn measures_response(&self) -> bool {
        self.response.as_deref() == Some("measure")
    }
}

/// Settings of a new rig.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "New rigs")]
pub(crate) struct NewRigArgs {
    /// Columns and rows of the light source's image: the recommended patterns are made for it.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[usize; 2]>,
    /// Number of recommended patterns: 3, 5 or 8.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub images: usize,
    /// Other patterns: a folder that `nelu3d patterns` wrote.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["size", "images"])]
    pub patterns: Option<PathBuf>,
    /// The board: a file with the table [board] of rig.toml.
    #[arg(long, value_name = "FILE")]
    pub board: Option<PathBuf>,
    /// Intrinsics of the camera, if they are known already.
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Color format of the camera's pictures (default: rgb for a webcam, mono otherwise).
    #[arg(long, value_name = "CHANNELS", value_parser = parse_channels)]
    pub channels: Option<Channels>,
    /// The camera's code for no light.
    #[arg(long, value_name = "CODE", value_parser = parse_code, default_value_t = 0.0)]
    pub black_level: f64,
    /// The camera's code at and above which a value is saturated: 255, 4095, 65535 (default: 255, or what the pixels of a
    /// GigE Vision or USB3 Vision camera have).
    #[arg(long, value_name = "CODE", value_parser = parse_code)]
    pub saturation: Option<f64>,
}

/// Where a camera is in the network; none: wherever it answers.
#[cfg(feature = "gige")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct GigeAddress(pub(crate) Option<std::net::IpAddr>);

#[cfg(feature = "gige")]
fn gige_address(text: &str) -> Result<GigeAddress, String> {
    match (text, text.parse()) {
        ("auto", _) => Ok(GigeAddress(None)),
        (_, Ok(address)) => Ok(GigeAddress(Some(address))),
        _ => Err("an address as 192.168.1.20, or auto".into()),
    }
}
