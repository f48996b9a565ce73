//! Why a pattern cannot be made, and the checks that all families share.

/// The longest side a pattern may have, px.
pub(super) const MAX_SIDE_PX: usize = 32_768;

/// Why a pattern cannot be made.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PatternError {
    /// The size of the light source's image.
    #[error("a pattern of {width} x {height} px cannot be made; give each side 1 to {MAX_SIDE_PX} px")]
    Size {
        /// Columns asked for.
        width: usize,
        /// Rows asked for.
        height: usize,
    },
    /// A setting out of its range.
    #[error("pattern {family}: `{key}` is {value}; {remedy}")]
    Setting {
        /// The family.
        family: &'static str,
        /// The setting.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        remedy: &'static str,
    },
    /// Three channels that do not fit together.
    #[error("pattern rgb: its three parts make {counts:?} images; let each make the same number, in one channel")]
    Parts {
        /// Images of each part.
        counts: [usize; 3],
    },
    /// Images that are no code of a family.
    #[error("these images are no code of the family {family}: {problem}")]
    Code {
        /// The family.
        family: &'static str,
        /// What is wrong.
        problem: &'static str,
    },
    /// Only some of a set's patterns have inverses.
    #[error("some patterns of the set have inverse images and some have none; give all of them inverses, or none")]
    PartialInverse,
}

/// Checks that a period is one a pixel grid can hold.
pub(super) fn check_period(family: &'static str, key: &'static str, value: f64) -> Result<(), PatternError> {
    if (2.0..=1e6).contains(&value) {
        return Ok(());
    }
    Err(PatternError::Setting { family, key, value, remedy: "give a period of 2 px or more" })
}
