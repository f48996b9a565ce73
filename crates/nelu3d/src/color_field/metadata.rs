//! Metadata of a color field: what it was made from, and how good it is.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use nelu3d_scan::pose::Bend;
use serde::{Deserialize, Serialize};

use super::depth_noise::DepthNoise;
use super::frame::Center;
use super::motion::LightMotion;
use crate::sensor::{Blur, CrosstalkMatrix, DarkLevel, NoiseModel};

/// Least standard deviation of a color field's own error, normalized intensity: interreflection, nonlinearity of the
/// sensor and the like never vanish.
pub const LEAST_MODEL_SIGMA: f32 = 0.005;

/// Metadata of a color field, stored with it: what it was made from, and how good it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldMetadata {
    /// Version of nelu3d that made it.
    pub version: String,
    /// The rig's name.
    pub rig: String,
    /// The pattern set's name.
    pub set: String,
    /// File names of the set's images, in order.
    pub images: Vec<String>,
    /// File names of the set's images that are mono images of a color camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mono: Vec<String>,
    /// Number of channels of an image: 1 or 3.
    pub channels: usize,
    /// Center of the frame.
    pub center: Center,
    /// Source of the field: "sweep" or "projector".
    pub source: String,
    /// Key of the camera: `[width, height, fx, fy, cx, cy]`, then the distortion coefficients.
    pub camera: Vec<f64>,
    /// Noise of the sensor.
    pub noise: NoiseModel,
    /// Blur of the camera, as the sweep's boards showed it; `None` where no sweep did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blur: Option<Blur>,
    /// Dark level per channel, for scenes without a black image.
    pub dark: Vec<DarkLevel>,
    /// Crosstalk of the camera, if it was measured: it then need not be estimated from scenes.
    #[serde(default, rename = "mixing", alias = "crosstalk")]
    pub crosstalk: Option<CrosstalkMatrix>,
    /// Number of cells (for a network, of the spline that it is read as) per pixel across; 1 unless the codes are finer
    /// than pixels.
    #[serde(default = "one", rename = "fineness", alias = "cells_per_pixel")]
    pub cells_per_pixel: usize,
    /// Typical distance between board positions along a ray, mm.
    pub step_mm: f64,
    /// Quality of its predictions at held-out positions.
    pub quality: Option<Quality>,
    /// What the codewords of scenes leave beside a field from a calibrated projector; `None` for a field from a sweep,
    /// and in fields of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual: Option<ProjectorResidual>,
    /// Codes of the warnings of its calibration; none where it is good.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Where the boards of its sweep stood; empty where there was none, and in fields of older versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boards: Vec<BoardPlace>,
    /// Bend of the sweep's board, where it was taken into account.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_bend: Option<Bend>,
    /// Motions of the light since the sweep that the field was corrected for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub corrected: Vec<LightMotion>,
    /// Settings that it was made with.
    pub settings: serde_json::Value,
}

impl FieldMetadata {
    /// Returns the factor of the noise's variance for depths that average over so many pixels, where so many positions
    /// support the field (`None`: not counted); see [`DepthNoise`].
    pub fn depth_noise_factor(&self, pixels: f32, positions: Option<u8>) -> f32 {
        self.quality.as_ref().and_then(|q| q.depth_noise.as_ref()).map_or(1.0, |n| n.factor(pixels, positions))
    }

    /// Returns the variances of the field's errors, noise included, and of noise alone, normalized intensity squared:
    /// at held-out positions, or on the scenes that a field from a projector was fitted to; `None` where neither is
    /// known.
    fn variances(&self) -> Option<[f64; 2]> {
        let of_projector = || self.residual.map(|r| [r.sigma * r.sigma, r.noise_sigma * r.noise_sigma]);
        let of_positions = |q: &Quality| [q.psnr_db, q.ceiling_db].map(|db| 10f64.powf(-db / 10.0));
        self.quality.as_ref().map(of_positions).or_else(of_projector)
    }

    /// Returns whether unseen positions are predicted to within 3 dB of what noise allows; true for a field from a
    /// calibrated projector, which has no positions.
    pub fn is_at_its_noise(&self) -> bool {
        self.quality.as_ref().is_none_or(|q| q.psnr_db > q.ceiling_db - 3.0)
    }

    /// Returns the standard deviation of the color field's own error, normalized intensity: what it is off by beyond
    /// noise, and at least `min`, because interreflection, nonlinearity of the sensor and the like never vanish.
    pub fn model_sigma(&self, min: f32) -> f32 {
        let excess = self.variances().map_or(1e-4, |[error, noise]| (error - noise).max(0.0));
        (excess.sqrt() as f32).max(min)
    }
}

/// What the codewords of scenes leave beside a field from a calibrated projector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectorResidual {
    /// Root of their mean squared distance from the field, normalized intensity.
    pub sigma: f64,
    /// Standard deviation that noise alone gives them, normalized intensity: root of the mean variance, of
    /// points that were decoded of the median.
    pub noise_sigma: f64,
    /// Covariance, mm², of the displacement a + b x/z + c y/z, mm, that errors of the projector's calibration leave
    /// along the ray through (x, y, z): 3 × 3, in the order (a, b, c), as the boards of a sweep tell it. `None` without
    /// a sweep of three boards, and in fields of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_covariance: Option<[[f64; 3]; 3]>,
}

/// Where the board stood at a position of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardPlace {
    /// Name of the position.
    pub position: String,
    /// Rotation, camera from board, as a unit quaternion (w, x, y, z).
    pub rotation: [f64; 4],
    /// Translation, camera from board, mm.
    pub translation_mm: [f64; 3],
}

impl BoardPlace {
    /// Makes the place of a position from the board's pose, camera from board, mm.
    pub fn new(position: &str, pose: &Isometry3<f64>) -> Self {
        let q = pose.rotation.quaternion();
        let rotation = [q.w, q.i, q.j, q.k];
        Self { position: position.into(), rotation, translation_mm: pose.translation.vector.into() }
    }

    /// Returns the board's pose, camera from board, mm.
    pub fn pose(&self) -> Isometry3<f64> {
        let [w, i, j, k] = self.rotation;
        let [x, y, z] = self.translation_mm;
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
        Isometry3::from_parts(Translation3::new(x, y, z), rotation)
    }
}

fn one() -> usize {
    1
}

/// The quality of a field's predictions at board positions that were held out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Names of the held-out positions.
    pub held_out: Vec<String>,
    /// Number of samples that were compared.
    pub n: usize,
    /// PSNR over well-lit samples (white − black of at least 10 % of full scale, or half of what the position's
    /// best-lit tenth has, if that is less), peak 1, dB.
    #[serde(deserialize_with = "or_nan")]
    pub psnr_db: f64,
    /// PSNR over every usable sample (dim ones, on black ink, are mostly noise), dB.
    #[serde(deserialize_with = "or_nan")]
    pub psnr_all_db: f64,
    /// PSNR of a perfect field over the same well-lit samples, by the estimated noise of the held-out images, dB. A
    /// good field can exceed this estimate by a few tenths.
    #[serde(deserialize_with = "or_nan")]
    pub ceiling_db: f64,
    /// Median depth error that the field's error implies: |error| / |∂c/∂t|, mm.
    #[serde(deserialize_with = "or_nan")]
    pub depth_mm: f64,
    /// Standard deviation of depth that errors of the boards' poses and shapes leave where all boards were, mm: root
    /// mean square displacement of held-out boards, and of squares of pixels on them, from the field of the others,
    /// along the rays, by the root of the number of boards. 0 where it was not measured. Errors that all boards share
    /// (a wrong focal length) are not in it.
    #[serde(default)]
    pub pose_mm: f64,
    /// Covariance, mm², of the displacement a + b x/z + c y/z, mm, that errors of the boards' poses leave where all
    /// boards were, along the ray through (x, y, z): 3 × 3, in the order (a, b, c), with what is no plane in a's
    /// variance. [`Self::pose_mm`] is its root mean square over the boards; poses are wrong by angles, too. `None`
    /// where no board could be compared, and in fields of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_covariance: Option<[[f64; 3]; 3]>,
    /// One standard deviation of the distance in depth, mm, of a board from the field of others, as far as squares of
    /// some pixels share it, from those that were held out: where codewords were carried from beside, where one other
    /// board has lit the same rays of light, where two have, and where more have. `None` where positions were not held
    /// out in turn, and in fields of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_by_support: Option<[f64; 4]>,
    /// Fraction of the squares of pixels on held-out boards that are gross errors: five times further off than most.
    /// `None` as above.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gross: Option<f64>,
    /// How much more depths scatter than noise makes them. `None` where too little of the held-out positions tells, for
    /// fields that are networks, and in fields of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_noise: Option<DepthNoise>,
    /// Quality at random held-out samples of the other positions; form `published` alone has it, which is trained for
    /// that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<PixelQuality>,
}

/// The quality of a field's predictions at random samples that were held out, of positions that were not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PixelQuality {
    /// Number of values that were compared.
    pub n: usize,
    /// PSNR over the samples whose precision is at least the median one, peak 1, dB.
    #[serde(deserialize_with = "or_nan")]
    pub psnr_db: f64,
}

/// Reads a number that may be null. JSON has no NaN or infinity: both are written as null, and what was never measured
/// must not make a field unreadable.
fn or_nan<'de, D: serde::Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(d)?.unwrap_or(f64::NAN))
}
