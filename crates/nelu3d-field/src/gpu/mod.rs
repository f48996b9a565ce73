//! The GPU forms of the kernels, through wgpu: Vulkan, Metal or Direct3D 12, whatever the machine has, no toolkit.
//!
//! [`Gpu`] is an opened device, `program.rs` what is run on it. Of the operations, `net.rs` is an encoding with its network and
//! optimizer, `field.rs` the regression made of it, `surface.rs` volume rendering. Shaders are WGSL files in `shaders/`, one per
//! kernel, completed with the sizes of the problem as constants.
//!
//! Results differ from the CPU's by rounding, and from run to run: the gradients of a table are summed by atomic additions, in
//! whatever order they come.

mod adapter;
mod bench;
mod field;
mod net;
pub(crate) mod program;
mod surface;
mod timing;

pub use adapter::{Gpu, list};
pub use bench::{GpuReport, PhaseResult};
pub use field::Samples;
pub use surface::{AmbientUse, RayScene, ScenePixel, SurfaceTraining, TrainingReport};

/// The GPU that tests run on: the one that NELU3D_TEST_DEVICE names (as `gpu:1`), else the first, be it a software driver. `None` if there is none, and loudly; with NELU3D_REQUIRE_GPU set
/// that is a failure.
#[cfg(test)]
fn test_choice() -> Option<crate::device::Choice> {
    use crate::device::Choice;
    let named = std::env::var("NELU3D_TEST_DEVICE").ok().map(|t| t.parse().expect("a device"));
    let number = |n: Option<usize>| n.map(Choice::GpuAt);
    let choice = named.or_else(|| number(list().iter().position(|f| f.unusable.is_none())));
    if choice.is_none() {
        assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "no GPU, and NELU3D_REQUIRE_GPU is set");
        eprintln!("SKIPPED: GPU tests: no GPU and no software driver (Debian: apt-get install mesa-vulkan-drivers)");
    }
    choice
}

/// Shared by all tests.
#[cfg(test)]
pub(crate) fn test_gpu() -> Option<std::sync::Arc<Gpu>> {
    test_choice().map(|choice| Gpu::open(choice).expect("it was listed"))
}

/// One to break; its kernels are the other forms, where there are two.
#[cfg(test)]
pub(crate) fn test_gpu_alone() -> Option<std::sync::Arc<Gpu>> {
    test_choice().map(|choice| Gpu::the_other_way(choice).expect("it was listed"))
}
