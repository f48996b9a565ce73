//! The device that is asked for.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The device that the user asks for.
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
    /// The GPU of that number in [`list`](super::list).
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
