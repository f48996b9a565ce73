//! Where kernels run: on this machine's cores, or on a GPU.
//!
//! Callers name a [`Choice`] and get a [`Device`]; which of the two it is matters only inside this crate. A build without the
//! feature `gpu` has the same types and knows one device.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
#[cfg(feature = "gpu")]
use std::sync::Arc;

/// What the user asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Choice {
    /// The first real GPU; without one, the CPU.
    #[default]
    Auto,
    /// This machine's cores.
    Cpu,
    /// The first GPU, a real one before a software driver.
    Gpu,
    /// The GPU of that number in [`list`].
    GpuAt(usize),
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => write!(f, "auto"),
            Self::Cpu => write!(f, "cpu"),
            Self::Gpu => write!(f, "gpu"),
            Self::GpuAt(n) => write!(f, "gpu:{n}"),
        }
    }
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            "gpu" => Ok(Self::Gpu),
            _ => text.strip_prefix("gpu:").and_then(|n| n.parse().ok()).map(Self::GpuAt).ok_or_else(|| {
                format!("`{text}` is no device; give auto, cpu, gpu, or gpu:N with N from `nelu3d devices`")
            }),
        }
    }
}

impl From<Choice> for String {
    fn from(choice: Choice) -> Self {
        choice.to_string()
    }
}

impl TryFrom<String> for Choice {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// A device that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// How to ask for it.
    pub device: Choice,
    /// What it calls itself.
    pub name: String,
    /// `discrete`, `integrated`, `virtual`, `software` or `unknown`.
    pub kind: &'static str,
    /// The interface it is reached by, as `vulkan`.
    pub backend: String,
    /// Driver and version.
    pub driver: String,
    /// Largest buffer of a kernel, bytes.
    #[serde(rename = "most_buffer_bytes")]
    pub max_buffer_bytes: u64,
    /// What it has beyond what is needed, as `f32-atomics`.
    pub features: Vec<&'static str>,
    /// Why it cannot be used; `None` if it can.
    pub unusable: Option<String>,
    /// Whether [`Choice::Auto`] takes it.
    pub automatic: bool,
}

/// Bytes for people.
fn amount(bytes: u64) -> String {
    if bytes < 1_000_000 { format!("{bytes} bytes") } else { format!("{} MB", bytes.div_ceil(1_000_000)) }
}

/// Why there is no device, or no longer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeviceError {
    /// The program has no GPU code in it.
    #[error(
        "--device {0}: this build has no GPU code; build with `--features gpu` (cargo install --path crates/nelu3d-cli --features gpu), or use --device cpu"
    )]
    NotBuilt(Choice),
    /// No such device.
    #[error("--device {choice}: {reason}; see `nelu3d devices`, or use --device cpu")]
    None {
        /// What was asked for.
        choice: Choice,
        /// Why not.
        reason: String,
    },
    /// A buffer does not fit.
    #[error(
        "{device}: {what} needs {}, {}; use a smaller problem (--samples, --max-labels), another --device, or --device cpu",
        amount(*needed),
        if *max > 0 { format!("more than the {} that there are", amount(*max)) } else { "which is not free there".into() }
    )]
    Memory {
        /// The device.
        device: String,
        /// What for.
        what: String,
        /// Bytes.
        needed: u64,
        /// Bytes of the largest buffer; 0 if its memory as a whole was too small.
        max: u64,
    },
    /// A kernel would need more workgroups than can be started at once.
    #[error(
        "{device}: `{what}` would take {asked} workgroups, and {max} is the most there; use fewer --samples, another --device, or --device cpu"
    )]
    Size {
        /// The device.
        device: String,
        /// The kernel.
        what: String,
        /// Workgroups along an axis.
        asked: usize,
        /// The most there are.
        max: usize,
    },
    /// It stopped answering.
    #[error("{device}: the device was lost ({reason}); run again, or use --device cpu")]
    Lost {
        /// The device.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// A fault of this program or of the driver.
    #[error("{device}: {reason}; please report this, and use --device cpu")]
    Failed {
        /// The device.
        device: String,
        /// What the driver said.
        reason: String,
    },
}

/// See the module.
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
    /// There is none such. [`Choice::Auto`] never fails.
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

    /// The same, or the CPU if there is none such: for the middle of work that began with a device that was there.
    pub fn or_cpu(choice: Choice) -> Self {
        Self::open(choice).unwrap_or(Self::Cpu)
    }

    /// Its name.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu => "cpu".into(),
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => gpu.name().to_owned(),
        }
    }

    /// Whether it is this machine's cores.
    pub fn is_cpu(&self) -> bool {
        matches!(self, Self::Cpu)
    }
}

/// All GPUs that were found, usable or not, in the order of their numbers.
pub fn list() -> Vec<Found> {
    #[cfg(feature = "gpu")]
    return crate::gpu::list();
    #[cfg(not(feature = "gpu"))]
    Vec::new()
}

/// Whether this build can use a GPU at all.
pub const fn has_gpu_code() -> bool {
    cfg!(feature = "gpu")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_as_they_are_written() {
        for choice in [Choice::Auto, Choice::Cpu, Choice::Gpu, Choice::GpuAt(3)] {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        for text in ["", "gpu:", "gpu:-1", "GPU", "cuda"] {
            assert!(text.parse::<Choice>().unwrap_err().contains("nelu3d devices"), "{text}");
        }
    }

    #[test]
    fn what_does_not_exist_is_named() {
        assert!(Device::open(Choice::Cpu).unwrap().is_cpu());
        let e = Device::open(Choice::GpuAt(999)).unwrap_err().to_string();
        assert!(e.contains("gpu:999") && e.contains("--device cpu"), "{e}");
    }
}
