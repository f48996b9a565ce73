//! A bump after the sweep.

use serde::{Deserialize, Serialize};

/// Camera or light source turned after the sweep, as when someone bumps into it: each about its own center. Lengths in
/// camera pixels, where the camera's axis meets the scene, or where the light's axis does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BumpSpec {
    /// How far the camera's picture moves, x and y.
    #[serde(default)]
    pub camera_px: [f64; 2],
    /// How far the light's pattern moves on what it falls on, x and y.
    #[serde(default)]
    pub light_px: [f64; 2],
}
