//! The GPU that tests run on.

use nelu3d_field::device::{Choice, Device};
use nelu3d_field::gpu::{Gpu, list};
use std::sync::Arc;

/// Returns the GPU that tests run on: the one that NELU3D_TEST_DEVICE names (as `gpu:1`), else the first, be it a
/// software driver. `None` if there is none, and loudly; with NELU3D_REQUIRE_GPU set that is a failure.
fn test_choice() -> Option<Choice> {
    let named = std::env::var("NELU3D_TEST_DEVICE").ok().map(|t| t.parse().expect("a device"));
    let number = |n: Option<usize>| n.map(Choice::GpuAt);
    let choice = named.or_else(|| number(list().iter().position(|f| f.unusable.is_none())));
    if choice.is_none() {
        assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "no GPU, and NELU3D_REQUIRE_GPU is set");
        eprintln!("SKIPPED: GPU tests: no GPU and no software driver (Debian: apt-get install mesa-vulkan-drivers)");
    }
    choice
}

/// Returns the device that all tests share.
pub(crate) fn test_gpu() -> Option<Arc<Gpu>> {
    test_choice().map(|choice| match Device::open(choice).expect("it was listed") {
        Device::Gpu(gpu) => gpu,
        Device::Cpu => panic!("`{choice}` is no GPU"),
    })
}

/// Returns a device of one's own, to break; its kernels are the other forms, where there are two.
pub(crate) fn test_gpu_alone() -> Option<Arc<Gpu>> {
    test_choice().map(|choice| Gpu::the_other_way(choice).expect("it was listed"))
}
