//! States of the light source.

/// The state of the light source in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Illumination {
    /// The white image (flash).
    White,
    /// The black image, as the spec declares it.
    Black,
    /// A pattern: its index among all images the light source can show.
    Pattern(usize),
}
