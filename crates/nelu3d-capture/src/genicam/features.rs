//! What a camera can be asked and told, by the names of the Standard Features Naming Convention of GenICam.

use std::fmt;

/// Why a feature cannot be read, written or run.
#[derive(Debug)]
pub(super) struct FeatureError {
    /// Whether the camera has the feature and gives no access to it now.
    pub(super) no_access: bool,
    /// What the driver says.
    pub(super) text: String,
}

impl fmt::Display for FeatureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// A camera's features, whatever it is plugged into. What is read is what the camera says now, never what was written
/// before.
pub(super) trait Features {
    /// Says whether the camera has this feature at all.
    fn has(&self, name: &str) -> bool;
    /// Returns the entries of a feature that is one of several.
    fn entries(&mut self, name: &str) -> Result<Vec<String>, FeatureError>;
    /// Returns the entry that is chosen.
    fn entry(&mut self, name: &str) -> Result<String, FeatureError>;
    /// Chooses an entry.
    fn choose(&mut self, name: &str, entry: &str) -> Result<(), FeatureError>;
    /// Switches something on or off.
    fn switch(&mut self, name: &str, on: bool) -> Result<(), FeatureError>;
    /// Returns a number, in the feature's unit.
    fn number(&mut self, name: &str) -> Result<f64, FeatureError>;
    /// Sets a number, in the feature's unit.
    fn set_number(&mut self, name: &str, value: f64) -> Result<(), FeatureError>;
    /// Sets a whole number.
    fn set_integer(&mut self, name: &str, value: i64) -> Result<(), FeatureError>;
    /// Runs a command.
    fn run(&mut self, name: &str) -> Result<(), FeatureError>;
}
