//! The frames around a frame, and how the scene moves between them.

use std::sync::OnceLock;

use nelu3d_scan::Image;

use super::motion::Motion;

/// White (flash) images of the previous and the next frame, and the motion that they show.
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

    /// Returns the white images of the neighbors that there are.
    pub(super) fn whites(&self) -> Vec<&Image> {
        self.before.iter().chain(&self.after).collect()
    }

    /// Returns how the points of the white image `taken` between them move; `None` if neither neighbor determines it.
    /// Motion is estimated once, at the first call. It needs white images alone, so a caller may ask for it while the
    /// previous frame is still being computed.
    pub fn motion(&self, taken: &Image) -> Option<&Motion> {
        self.motion.get_or_init(|| Motion::around(self.before.as_ref(), taken, self.after.as_ref())).as_ref()
    }
}
