//! The color field c(x): position → normalized intensities of the k patterns (paper, Sec. 3.1).
//!
//! A field is a [`frame::FieldFrame`] (coordinates in which c is easy to interpolate), a form (how c is stored there)
//! and a [`validity::Validity`] volume (where it was supervised). Forms: [`grid`] (cubic B-spline, least squares),
//! [`hash`] (multiresolution hash encoding and a small network), [`frequency`] (sines and cosines and a network) and
//! [`published`] (the paper's own hash encoding, which recipe `paper` queries directly). To add a form: a variant of
//! [`Form`], its file, its tensors in [`checkpoint`], and [`ColorField::to_grid`], through
//! which everything downstream reads it.

pub mod bins;
mod camera_rays;
pub mod checkpoint;
mod compatibility;
mod continued;
mod depth_noise;
mod field;
pub mod fit;
pub mod frame;
pub mod frequency;
pub mod grid;
pub mod hash;
mod metadata;
mod motion;
mod network;
pub mod published;
mod spline_evaluator;
pub mod validity;

pub use camera_rays::CameraRays;
pub use compatibility::{FieldMismatch, camera_key, check_field, check_mono};
pub use depth_noise::{DepthNoise, SupportedDepthNoise};
pub use field::{ColorField, Form};
pub use metadata::{BoardPlace, FieldMetadata, LEAST_MODEL_SIGMA, PixelQuality, ProjectorResidual, Quality};
pub use motion::LightMotion;
pub use spline_evaluator::SplineEvaluator;
