//! Where kernels run: on this machine's cores, or on a GPU.
//!
//! Callers name a [`Choice`] and get a [`Device`]; which of the two it is matters only inside this crate. A build
//! without the feature `gpu` has the same types and knows one device.

mod choice;
mod error;
mod found;

pub use choice::Choice;
pub use error::DeviceError;
pub use found::Found;

#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
#[cfg(feature = "gpu")]
use std::sync::Arc;

/// An opened device.
#[derive(Clone, Debug)]
pub enum Device {
    /// This machine's cores.
    Cpu,
    /// A GPU.
    #[cfg(feature = "gpu")]
    Gpu(Arc<Gpu>),
}

impl Device {
    /// Opens a device; the same choice gives the same one.
    ///
    /// # Errors
    ///
    /// There is no such device. [`Choice::Auto`] never fails.
    pub fn open(choice: Choice) -> Result<Self, DeviceError> {
        match choice {
            Choice::Cpu => Ok(Self::Cpu),
            #[cfg(feature = "gpu")]
            Choice::Auto => Ok(Gpu::open(choice).map_or(Self::Cpu, Self::Gpu)),
            #[cfg(feature = "gpu")]
            Choice::Gpu | Choice::GpuAt(_) => Gpu::open(choice).map(Self::Gpu),
            #[cfg(not(feature = "gpu"))]
            Choice::Auto => Ok(Self::Cpu),
            #[cfg(not(feature = "gpu"))]
            Choice::Gpu | Choice::GpuAt(_) => Err(DeviceError::NotBuilt(choice)),
        }
    }

    /// Opens a device, or the CPU if there is no such device: for the middle of work that began with one that was
    /// there.
    pub fn or_cpu(choice: Choice) -> Self {
        Self::open(choice).unwrap_or(Self::Cpu)
    }

    /// Returns its name.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu => "cpu".into(),
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => gpu.name().to_owned(),
        }
    }

    /// Returns whether it is this machine's cores.
    pub fn is_cpu(&self) -> bool {
        matches!(self, Self::Cpu)
    }
}

/// Returns all GPUs that were found, usable or not, in the order of their numbers.
pub fn list() -> Vec<Found> {
    #[cfg(feature = "gpu")]
    return crate::gpu::list();
    #[cfg(not(feature = "gpu"))]
    Vec::new()
}

/// Returns whether this build can use a GPU at all.
pub const fn has_gpu_code() -> bool {
    cfg!(feature = "gpu")
}
