//! What shows the patterns.

use std::time::Duration;

use crate::error::CaptureError;

/// An image to show over the whole of the light source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Slide {
    /// Every pixel at its maximum: the flash.
    White,
    /// Every pixel dark.
    Black,
    /// An image of the pattern set, by its place: the patterns, then their inverses.
    Pattern(usize),
}

/// A light source that can be told what to show.
pub trait Display {
    /// Shows a slide until the next one, and returns when it said that it did. The answer may be early or late by any
    /// constant that stays the same: the flashes measure it.
    ///
    /// # Errors
    ///
    /// The light source is gone, or does not answer.
    fn show(&mut self, slide: Slide) -> Result<Duration, CaptureError>;
}
