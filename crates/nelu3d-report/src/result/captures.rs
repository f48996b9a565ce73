//! The captures that a page shows.

use nelu3d_scan::rig::{PatternSet, RigError, Shot};
use nelu3d_scan::{Image, Rig};

/// Maximum width of pictures of captures, px.
pub(super) const MAX_CAPTURE_WIDTH: usize = 320;

/// The captures of a scene, reduced to about the size at which a page shows them.
#[derive(Clone, Debug)]
pub struct Captures {
    /// White (flash) and the patterns, with their names; white first.
    pub(super) images: Vec<(String, Image)>,
    /// The scene without the light source, when there is such an image.
    pub(super) black: Option<Image>,
}

impl Captures {
    /// Reads the captures of a scene of a rig under the patterns of a set, one after the other: all of a large camera's
    /// take more memory than its result.
    ///
    /// # Errors
    ///
    /// An image cannot be read.
    pub fn read(rig: &Rig, set: &PatternSet, shot: &Shot) -> Result<Self, RigError> {
        let reduced = |image: &Image| image.binned((image.width / MAX_CAPTURE_WIDTH).max(1));
        let mut reader = rig.reader(shot);
        let white = reader.read(&rig.white)?;
        let has_black = rig.has_image(&shot.dir.join(&rig.black));
        let black = has_black.then(|| reader.read(&rig.black)).transpose()?;
        let mut images = vec![(rig.white.clone(), reduced(&white))];
        for name in &set.images {
            let (pattern, _) = reader.read_pattern(name, &white, black.as_ref())?;
            images.push((name.clone(), reduced(&pattern)));
        }
        Ok(Self { images, black: black.as_ref().map(reduced) })
    }
}
