//! Which training a checkpoint belongs to: its method and settings as text, and a SHA-256 digest of what it sees.

use serde::Serialize;
use sha2::{Digest, Sha256};

/// What a checkpoint must have been made of to go on with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Method, version of the program and settings.
    pub(super) settings: String,
    /// Digest of what the training sees.
    pub(super) scene: [u8; 32],
}

/// Collects what a training sees.
#[derive(Default)]
pub struct SceneDigest(Sha256);

impl SceneDigest {
    /// Adds values; their number counts too.
    pub fn floats(&mut self, values: &[f32]) -> &mut Self {
        self.bytes(bytemuck::cast_slice(values))
    }

    /// Adds indices.
    pub fn indices(&mut self, values: &[u32]) -> &mut Self {
        self.bytes(bytemuck::cast_slice(values))
    }

    /// Adds anything that can be written as text.
    pub fn text(&mut self, value: &impl Serialize) -> &mut Self {
        self.bytes(&serde_json::to_vec(value).expect("plain data serializes"))
    }

    fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
        self
    }
}

impl Identity {
    /// Makes the identity of a training by a method with given settings on what the digest has seen.
    pub fn new(method: &str, settings: &impl Serialize, scene: SceneDigest) -> Self {
        let settings = serde_json::to_string(settings).expect("plain data serializes");
        let settings = format!("{method} {} {settings}", env!("CARGO_PKG_VERSION"));
        Self { settings, scene: scene.0.finalize().into() }
    }
}
