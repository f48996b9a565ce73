//! The color field c(x): position → normalized intensities of the k patterns (paper, Sec. 3.1).
//!
//! A field is a [`Frame`] (coordinates in which c is easy to interpolate), a form (how c is stored there) and a
//! [`Validity`] volume (where it was supervised). Forms: [`grid`] (cubic B-spline, least squares), [`hash`]
//! (multiresolution hash encoding and a small network) and [`frequency`] (sines and cosines and a network). To add a form: a variant of [`Form`], its file, its tensors in
//! [`checkpoint`], and [`ColorField::to_grid`], through which everything downstream reads it.

pub mod bins;
pub mod checkpoint;
pub mod fit;
pub mod frame;
pub mod frequency;
pub mod grid;
pub mod hash;
mod network;
pub mod validity;

use serde::{Deserialize, Serialize};

use crate::calibrate::dark::DarkLevel;
use crate::calibrate::noise::NoiseModel;
use crate::reconstruct::Mixing;
use frame::{Center, Frame};
use frequency::FrequencyForm;
use grid::Grid;
use hash::HashForm;
use validity::Validity;

/// How c is stored.
#[derive(Clone, Debug)]
pub enum Form {
    /// Cubic B-spline.
    Grid(Grid),
    /// Hash encoding and MLP.
    Hash(Box<HashForm>),
    /// Frequency encoding and MLP.
    Frequency(Box<FrequencyForm>),
}

/// A calibrated color field: everything that a reconstruction needs to know of the light source.
#[derive(Clone, Debug)]
pub struct ColorField {
    /// Its coordinates.
    pub frame: Frame,
    /// Its values.
    pub form: Form,
    /// Where it holds.
    pub validity: Validity,
    /// What it was made from.
    pub about: About,
}

/// What a field was made from; stored with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Version of nelu3d that made it.
    pub version: String,
    /// The rig's name.
    pub rig: String,
    /// The pattern set's name.
    pub set: String,
    /// File names of the set's images, in order.
    pub images: Vec<String>,
    /// Those of them that are mono images of a color camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mono: Vec<String>,
    /// Channels of an image: 1 or 3.
    pub channels: usize,
    /// Where the frame is centered.
    pub center: Center,
    /// "sweep" or "projector".
    pub source: String,
    /// Camera: `[width, height, fx, fy, cx, cy]`, then the distortion coefficients.
    pub camera: Vec<f64>,
    /// The sensor's noise.
    pub noise: NoiseModel,
    /// What is seen without the light source, per channel; for scenes without a black image.
    pub dark: Vec<DarkLevel>,
    /// How the camera mixes the light's colors, if that was measured: with one, scenes need not tell it.
    #[serde(default)]
    pub mixing: Option<Mixing>,
    /// Cells (for a network: of the spline it is read as) per pixel across; 1 unless the codes are finer than pixels.
    #[serde(default = "one")]
    pub fineness: usize,
    /// Typical distance between board positions along a ray, mm.
    pub step_mm: f64,
    /// How well it predicts positions it was not made from.
    pub quality: Option<Quality>,
    /// The settings it was made with.
    pub settings: serde_json::Value,
}

fn one() -> usize {
    1
}

/// How well a field predicts board positions that were held out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Names of the held-out positions.
    pub held_out: Vec<String>,
    /// Samples compared.
    pub n: usize,
    /// PSNR over well-lit samples (white − black of at least 10 % of full scale, or half of what the position's best-lit
    /// tenth has, if that is less), peak 1, dB.
    #[serde(deserialize_with = "or_nan")]
    pub psnr_db: f64,
    /// PSNR over every usable sample (dim ones, on black ink, are mostly noise), dB.
    #[serde(deserialize_with = "or_nan")]
    pub psnr_all_db: f64,
    /// PSNR of a perfect field over the same well-lit samples, by the estimated noise of the held-out images, dB. An estimate: a good field can exceed it by a few tenths.
    #[serde(deserialize_with = "or_nan")]
    pub ceiling_db: f64,
    /// Median depth error that the field's error implies: |error| / |∂c/∂t|, mm.
    #[serde(deserialize_with = "or_nan")]
    pub depth_mm: f64,
}

/// JSON has no NaN or infinity: both are written as null, and what was never measured must not make a field unreadable.
fn or_nan<'de, D: serde::Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(d)?.unwrap_or(f64::NAN))
}

impl ColorField {
    /// Number of pattern channels k.
    pub fn k(&self) -> usize {
        match &self.form {
            Form::Grid(g) => g.k,
            Form::Hash(h) => h.k(),
            Form::Frequency(f) => f.k(),
        }
    }

    /// The field as a spline, which every later stage evaluates.
    pub fn to_grid(&self) -> std::borrow::Cow<'_, Grid> {
        match &self.form {
            Form::Grid(g) => std::borrow::Cow::Borrowed(g),
            Form::Hash(h) => std::borrow::Cow::Owned(h.to_grid()),
            Form::Frequency(f) => std::borrow::Cow::Owned(f.to_grid()),
        }
    }

    /// Name of the form.
    pub fn form_name(&self) -> &'static str {
        match &self.form {
            Form::Grid(_) => "grid",
            Form::Hash(_) => "hash",
            Form::Frequency(_) => "frequency",
        }
    }
}
