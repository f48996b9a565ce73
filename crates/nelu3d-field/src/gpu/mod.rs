//! The GPU forms of the kernels, through wgpu: Vulkan, Metal or Direct3D 12, whatever the machine has, no toolkit.
//!
//! [`Gpu`] is an opened device, `program/` has the buffers and kernels that are run on it, `net/` an encoding with its
//! network and optimizer, `field.rs` the regression made of it, `surface/` volume rendering. Shaders are WGSL files in
//! `shaders/`, one per kernel, completed with the sizes of the problem as constants.
//!
//! Results differ from the CPU's by rounding, and from run to run: the gradients of a table are summed by atomic
//! additions, in whatever order they come.

mod adapter;
mod bench;
mod field;
mod net;
// For the tests of this crate, which stand outside of it.
#[doc(hidden)]
pub mod program;
mod surface;
mod timing;

pub use adapter::{Gpu, list};
pub use bench::{GpuReport, PhaseResult};
pub use field::Samples;
pub use surface::{AmbientUse, RayScene, ScenePixel, SurfaceTraining, TrainingReport};
