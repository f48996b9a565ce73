//! Training of a [`NeuralSurface`](crate::surface::NeuralSurface) on the device.
//!
//! `scene.rs` is what it is trained on, `buffers.rs` what lies on the device, `calls.rs` the kernels of a step in their
//! order, `training.rs` the training itself, `phases.rs` its measurement, `given.rs` a step that tests compare.

mod buffers;
mod calls;
mod given;
mod phases;
mod scene;
mod training;

pub use scene::{AmbientUse, RayScene, ScenePixel, TrainingReport};
pub use training::SurfaceTraining;
