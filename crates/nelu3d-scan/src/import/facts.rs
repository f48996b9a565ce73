//! What a file says about the sensor.

use crate::image::Channels;

/// What a file says about the sensor. Only DNG files say anything.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// How the sensor delivers color.
    pub channels: Option<Channels>,
    /// Sensor code for no light.
    pub black_level: Option<f64>,
    /// Sensor code at which a value is clipped.
    pub white_level: Option<f64>,
}
