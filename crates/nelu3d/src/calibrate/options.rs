//! Options of a calibration.

use nelu3d_field::device::Choice;
use serde::{Deserialize, Serialize};

use crate::color_field::frequency::Octaves;
use crate::color_field::published::PublishedOptions;

/// The form in which c is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FormKind {
    /// Cubic B-spline over the frame, fitted by least squares.
    Grid,
    /// Multiresolution hash encoding and a small network.
    Hash,
    /// Sines and cosines in octaves and a network.
    Frequency,
    /// The paper's own: a hash encoding in the camera's frame, equally fine along every axis, and a network.
    Published,
}

/// The center of the field's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FrameKind {
    /// In the light if that predicts held-out positions better, else in the camera.
    Auto,
    /// In the light source.
    Light,
    /// In the camera.
    Camera,
}

/// The motion of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum TrajectoryKind {
    /// On a stage if that explains the corners, else freely.
    Auto,
    /// Every pose on its own.
    Free,
    /// One rotation, positions on one line.
    Stage,
}

/// Settings of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationOptions {
    /// How the color field is stored
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().form))]
    pub form: FormKind,
    /// Octaves of the frequency form
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().octaves))]
    pub octaves: Octaves,
    /// Where the field's coordinates are centered
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().frame))]
    pub frame: FrameKind,
    /// How the board moved
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().trajectory))]
    pub trajectory: TrajectoryKind,
    /// A stage moved the board in steps of this length, in the order of the names, mm: then it is checked that the
    /// scale, which rests on the print's measures and the focal length, agrees
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "clap", arg(long = "step", value_name = "MM", value_parser = step))]
    pub step_mm: Option<f64>,
    /// Hold out every Nth board position to measure the field (the stored field is then fitted to all)
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().hold_out))]
    pub hold_out: usize,
    /// Leave this board position out of the sweep (may be repeated)
    #[cfg_attr(feature = "clap", arg(long, value_name = "NAME"))]
    pub leave_out: Vec<String>,
    /// Smallest white − black of a usable sample, as a fraction of full scale
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().min_contrast))]
    pub min_contrast: f32,
    /// Seed of everything random
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().seed))]
    pub seed: u64,
    /// Where form hash is trained: auto (a GPU, if there is one), cpu, gpu, or gpu:N as in `nelu3d devices`
    #[serde(skip)]
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().device))]
    pub device: Choice,
    /// Settings of form `published`.
    #[cfg_attr(feature = "clap", command(flatten))]
    pub published: PublishedOptions,
}

impl Default for CalibrationOptions {
    fn default() -> Self {
        Self {
            form: FormKind::Grid,
            octaves: Octaves::Supervised,
            frame: FrameKind::Auto,
            trajectory: TrajectoryKind::Auto,
            step_mm: None,
            hold_out: 8,
            leave_out: Vec::new(),
            min_contrast: 0.02,
            seed: 0,
            device: Choice::Auto,
            published: PublishedOptions::default(),
        }
    }
}

/// Parses the step of a stage.
#[cfg(feature = "clap")]
fn step(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mm) if (1e-4..=10_000.0).contains(&mm) => Ok(mm),
        _ => Err("a length in mm, from 0.0001 to 10000".into()),
    }
}
