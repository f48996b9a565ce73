//! Static scenes.

use serde::{Deserialize, Serialize};

use super::defaults::yes;
use super::object::ObjectSpec;

/// A static scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Its folder's name under scenes/.
    pub name: String,
    /// Whether it has a black.png.
    #[serde(default = "yes")]
    pub black: bool,
    /// Its objects.
    pub objects: Vec<ObjectSpec>,
}

impl SceneSpec {
    /// Returns a scene of objects, captured with a black image.
    pub fn new(name: &str, objects: Vec<ObjectSpec>) -> Self {
        Self { name: name.into(), black: true, objects }
    }
}
