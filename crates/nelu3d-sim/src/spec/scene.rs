//! Static scenes.

use serde::{Deserialize, Serialize};

use super::bump::BumpSpec;
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
    /// Position of the sweep at which the board stands in the scene too; none: there is no board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<String>,
    /// Bump of camera or light source between the sweep and this scene; none: neither moved. Objects and board stay
    /// where they are; truth is in the frame of the camera as it stands then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bump: Option<BumpSpec>,
    /// Its objects.
    #[serde(default)]
    pub objects: Vec<ObjectSpec>,
}

impl SceneSpec {
    /// Returns a scene of objects, captured with a black image.
    pub fn new(name: &str, objects: Vec<ObjectSpec>) -> Self {
        Self { name: name.into(), black: true, board: None, bump: None, objects }
    }
}
