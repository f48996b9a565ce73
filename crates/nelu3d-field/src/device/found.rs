//! The devices that there are.

use super::choice::Choice;
use serde::Serialize;

/// A device that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// The choice that asks for it.
    pub device: Choice,
    /// The name it gives itself.
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
    /// Abilities beyond those that are needed, as `f32-atomics`.
    pub features: Vec<&'static str>,
    /// Why it cannot be used; `None` if it can.
    pub unusable: Option<String>,
    /// Whether [`Choice::Auto`] takes it.
    pub automatic: bool,
}
