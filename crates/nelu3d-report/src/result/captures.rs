//! The captures that a page shows.

use nelu3d_scan::rig::{Capture, PatternSet};
use nelu3d_scan::{Image, Rig};

use super::MAX_CAPTURE_WIDTH;

/// The captures of a scene, reduced to about the size at which a page shows them.
#[derive(Clone, Debug)]
pub struct Captures {
    /// White (flash) and the patterns, with their names; white first.
    pub(super) images: Vec<(String, Image)>,
    /// The scene without the light source, when there is such an image.
    pub(super) black: Option<Image>,
}

impl Captures {
    /// Reduces the captures of a scene of a rig under the patterns of a set.
    pub fn new(rig: &Rig, set: &PatternSet, capture: Capture) -> Self {
        let reduced = |image: Image| match image.width / MAX_CAPTURE_WIDTH {
            0 | 1 => image,
            block => image.binned(block),
        };
        let mut images = vec![(rig.white.clone(), reduced(capture.white))];
        images.extend(set.images.iter().cloned().zip(capture.patterns.into_iter().map(reduced)));
        Self { images, black: capture.black.map(reduced) }
    }
}
