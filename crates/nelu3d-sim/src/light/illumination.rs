//! What the light source shows in an image.

/// What the light source shows in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Illumination {
    /// The white image (flash).
    White,
    /// What the spec says black is.
    Black,
    /// A pattern: its index among all images the light source can show.
    Pattern(usize),
}
