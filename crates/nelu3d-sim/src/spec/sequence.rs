//! Sequences: moving objects before the camera.

use serde::{Deserialize, Serialize};

use super::object::ObjectSpec;

/// A moving scene, captured frame after frame: each frame has its pattern images and one flash, taken one after
/// another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SequenceSpec {
    /// Its folder's name under sequences/.
    pub name: String,
    /// Frames per second: frame i begins at i / fps, which is the middle of its first pattern's exposure.
    pub fps: f64,
    /// Number of frames.
    pub frames: usize,
    /// Time from the first pattern's exposure to the flash's, seconds; negative where the flash comes first.
    #[serde(default)]
    pub flash_delay_secs: f64,
    /// Time from one pattern's exposure to the next one's, seconds.
    #[serde(default)]
    pub pattern_interval_secs: f64,
    /// The pattern set it is captured with; default: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern_set: Option<String>,
    /// Whether its frames have a black.png. Ambient light and what it falls on are those of the flash's moment.
    #[serde(default)]
    pub black: bool,
    /// Its moving objects.
    pub objects: Vec<MovingObjectSpec>,
}

/// An object and its motion. In a file the motion is one more key, `motion`, of the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "toml::Table", into = "toml::Table")]
pub struct MovingObjectSpec {
    /// The object as it is at the time 0.
    pub object: ObjectSpec,
    /// Its motion from there on.
    pub motion: MotionSpec,
}

/// Motion in the camera's frame, from the time 0 of a sequence on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSpec {
    /// Velocity at the time 0, mm/s.
    #[serde(default)]
    pub velocity_mm_per_sec: [f64; 3],
    /// Constant acceleration, mm/s²; free fall is `[0, 9810, 0]` for a level camera.
    #[serde(default)]
    pub acceleration_mm_per_sec2: [f64; 3],
    /// Constant angular velocity, a Rodrigues vector per second (rad/s) in the camera's frame, about the object's
    /// origin.
    #[serde(default)]
    pub angular_velocity: [f64; 3],
    /// The object's deformation swings with this frequency, Hz: its strength (amplitude, curvature or rate) is
    /// multiplied by cos(2π f t).
    #[serde(default)]
    pub vibration_hz: f64,
    /// Rate at which the phase of a deformation of kind `wave` grows, rad/s: the wave runs.
    #[serde(default)]
    pub phase_per_sec: f64,
}

/// The key of an object's motion in a file.
const MOTION: &str = "motion";

impl TryFrom<toml::Table> for MovingObjectSpec {
    type Error = toml::de::Error;

    fn try_from(mut table: toml::Table) -> Result<Self, Self::Error> {
        let motion = table.remove(MOTION).map_or_else(|| Ok(MotionSpec::default()), toml::Value::try_into)?;
        Ok(Self { object: table.try_into()?, motion })
    }
}

impl From<MovingObjectSpec> for toml::Table {
    fn from(moving: MovingObjectSpec) -> Self {
        let object: &dyn erased_serde::Serialize = &moving.object;
        let mut table = toml::Table::try_from(object).expect("an object is plain data with string keys");
        let motion = toml::Value::try_from(&moving.motion).expect("a motion is plain data with string keys");
        table.insert(MOTION.into(), motion);
        table
    }
}
