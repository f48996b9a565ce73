//! What was imported.

use std::path::PathBuf;

/// What was imported.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ImportReport {
    /// The folder that was written.
    #[serde(serialize_with = "crate::path_text::serialize")]
    pub output: PathBuf,
    /// The folder of frames.
    #[serde(serialize_with = "crate::path_text::serialize")]
    pub source: PathBuf,
    /// What consecutive frames are; `null` for one that is skipped.
    pub order: Vec<Option<String>>,
    /// File names of the first and last frame that were used.
    pub range: [String; 2],
    /// Frames that were used.
    pub frames: usize,
    /// Frames at the end that are no whole group, and were not used.
    pub left_over: usize,
    /// Groups that were used.
    pub groups: usize,
    /// Folders that were made of them.
    pub folders: usize,
    /// Whether the rig is new.
    pub new_rig: bool,
    /// The rig's channels, as in rig.toml.
    pub channels: String,
    /// The rig's sensor code for no light.
    pub black_level: f64,
    /// The rig's sensor code at which values are clipped.
    pub saturation: f64,
    /// How a new rig's levels were found.
    pub levels: Option<String>,
    /// What the user should know, one sentence each.
    pub notes: Vec<String>,
}
