//! The frames around a frame, and how the scene moves between them.

use std::sync::OnceLock;

use nelu3d_scan::Image;

use super::motion::Motion;

/// White (flash) images of the frames before and after.
#[derive(Default)]
pub struct Neighbors {
    pub(super) before: Option<Image>,
    pub(super) after: Option<Image>,
    motion: OnceLock<Option<Motion>>,
}

impl Neighbors {
    /// Holds the white images of the previous and the next frame; `None` at the ends of a sequence.
    pub fn new(before: Option<Image>, after: Option<Image>) -> Self {
        Self { before, after, motion: OnceLock::new() }
    }

    /// How the points of the flash `taken` between them move; `None` if neither neighbor tells. It takes nothing but flashes, so a caller may
    /// find it while the frame before is computed: it is found once, at the first call.
    pub fn motion(&self, taken: &Image) -> Option<&Motion> {
        self.motion.get_or_init(|| Motion::around(self.before.as_ref(), taken, self.after.as_ref())).as_ref()
    }
}
