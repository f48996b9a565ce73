//! What a decoding puts on record.

use nelu3d::progress::StageTime;
use nelu3d::surface::Surface;
use serde::Serialize;

use super::code::ProjectedLight;
use super::lookup3d::LookupDiagnostics;
use super::options::DecodeOptions;
use super::triangulate::DepthRange;
use super::turbosl::TurboSlDiagnostics;

/// A decoded scene.
#[derive(Clone, Debug)]
pub struct Decoding {
    /// The surface.
    pub surface: Surface,
    /// What the method puts on record.
    pub diagnostics: DecodeDiagnostics,
    /// Wall and CPU time of each stage, in order.
    pub stages: Vec<StageTime>,
}

/// What a decoding puts on record besides the surface and the times.
#[derive(Clone, Debug, Serialize)]
pub struct DecodeDiagnostics {
    /// What was asked for.
    pub settings: DecodeOptions,
    /// Number of images of the scene that were used, white and black included.
    pub images: usize,
    /// What only one kind of method knows.
    #[serde(flatten)]
    pub method: MethodDiagnostics,
}

/// What only one kind of method knows.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
#[allow(private_interfaces, reason = "callers write it, nobody reads it")]
pub enum MethodDiagnostics {
    /// Methods that triangulate with a calibrated projector.
    Triangulated {
        /// Between which depths the surface was looked for.
        depth_range: DepthRange,
        /// How projected values were taken to become light.
        light: ProjectedLight,
        /// The training of TurboSL.
        #[serde(flatten, skip_serializing_if = "Option::is_none")]
        training: Option<TurboSlDiagnostics>,
    },
    /// LookUp3D.
    Lookup(LookupDiagnostics),
}
