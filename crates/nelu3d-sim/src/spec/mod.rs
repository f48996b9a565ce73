//! What to simulate, declared: [`Spec`] is one value (or TOML file) that says everything about a virtual scanner and
//! its scenes. One file per section; `check/` tells whether the values make sense.

mod albedo;
mod axis;
mod board;
mod bump;
mod camera;
mod defaults;
mod deformation;
mod error;
mod file;
mod film;
mod interreflection;
mod light;
mod material;
mod object;
mod preset;
mod projector;
mod scene;
mod sequence;
mod shape;
mod simulation;
mod sweep;

pub use albedo::AlbedoSpec;
pub use axis::AxisSpec;
pub use board::{BoardBendSpec, BoardCurlSpec, BoardSpec};
pub use bump::BumpSpec;
pub use camera::{CameraSpec, PerColor};
pub use deformation::DeformationSpec;
pub use error::SpecError;
pub use film::FilmSpec;
pub use interreflection::InterreflectionSpec;
pub use light::LightSpec;
pub use material::MaterialSpec;
pub use object::ObjectSpec;
pub use preset::PRESETS;
pub use projector::{BlackImage, ProjectorSpec};
pub use scene::SceneSpec;
pub use sequence::{MotionSpec, MovingObjectSpec, SequenceSpec};
pub use shape::ShapeSpec;
pub use simulation::{PatternSetSpec, Spec};
pub use sweep::{DepthSpacing, HandsSpec, SweepSpec};
