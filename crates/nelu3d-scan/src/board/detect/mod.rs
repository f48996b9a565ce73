//! Finding a board in an image, in three steps: a coarse detection on 8 bits that says which corner is where to a pixel
//! or two (one file a kind), a smooth map from the board to the image fitted to it, and the final localization of every
//! corner from the edges that meet in it, on the linear image itself.

mod charuco;
mod check;
mod chessboard;
mod edge;
mod gray;
mod light;
mod markers;
mod pair;
mod pixels;
mod quads;
mod refine;
mod spec;
mod warp;

use calib_targets_aruco::Matcher;
use calib_targets_charuco::CharucoDetector;

use self::check::agreement;
use self::gray::{Decimated, stretch};
use self::pair::Pair;
use self::pixels::Pixels;
use self::spec::CornerSpec;
use self::warp::Warp;
use super::layout::Layout;
use super::{Artwork, Board, BoardError, Corner};
use crate::Camera;

/// Finds one board in images.
pub struct Detector {
    layout: Layout,
    artwork: Artwork,
    corners: Vec<CornerSpec>,
    camera: Option<Camera>,
    charuco: Option<charuco::Finder>,
    matcher: Option<Matcher>,
}

/// A board in an image.
#[derive(Clone, Debug)]
pub struct Sighting {
    /// The corners of the board that were found.
    pub corners: Vec<Corner>,
    /// Standard deviation of the image's blur beyond a pixel's own area, px: that of a Gaussian, the median over what the
    /// corners' edges show.
    pub blur_px: f64,
}

/// Images are reduced to about this many pixels for the coarse step; the final one works at full resolution.
const COARSE_PIXELS: usize = 1_500_000;

/// Smallest correlation between a board's bits and the image at them. A right one has more than 0.8 even in bad light,
/// a wrong one about 0.
const MIN_AGREEMENT: f64 = 0.5;

impl Detector {
    /// Prepares to find a board. Fails when it cannot be printed as described.
    pub fn new(board: &Board) -> Result<Self, BoardError> {
        let layout = Layout::new(board)?;
        let corners = spec::corners(&layout, board.extent_mm);
        let charuco = match &layout {
            Layout { squares: Some(_), dictionary: Some(_), .. } => Some(charuco::Finder::new(&layout)?),
            _ => None,
        };
        let matcher = layout.dictionary.as_ref().map(markers::matcher);
        // Everything is looked for at the sizes described: what a printer does to them is part of the board's homography.
        let artwork = Artwork::new(&Board { scale: [1.0, 1.0], ..board.clone() })?;
        Ok(Self { layout, artwork, corners, camera: None, charuco, matcher })
    }

    /// Tells the detector the camera that takes the images. Then the lens distortion is known between corners;
    /// otherwise it is estimated from each image (radial only), which takes a board that covers a good part of the
    /// image.
    #[must_use]
    pub fn with_camera(mut self, camera: &Camera) -> Self {
        self.camera = Some(camera.clone());
        self
    }

    /// Finds the board's corners in a linear image: `height × width` values in [0, 1], where 1 and more is clipped.
    /// Pixels of the answer follow the workspace's convention (centers at integers).
    ///
    /// Fails when the board is not there; finds at least four corners otherwise. Corners hidden, clipped or outside the
    /// image are rejected.
    pub fn detect(&self, gray: &[f32], width: usize, height: usize) -> Result<Vec<Corner>, BoardError> {
        self.sight(gray, width, height).map(|sighting| sighting.corners)
    }

    /// Does what [`Self::detect`] does, and tells the blur of the image as well.
    pub fn sight(&self, gray: &[f32], width: usize, height: usize) -> Result<Sighting, BoardError> {
        if width == 0 || height == 0 || gray.len() != width * height {
            return Err(BoardError::ImageSize { width, height, len: gray.len() });
        }
        if let Some(c) = &self.camera
            && (c.width, c.height) != (width, height)
        {
            let (camera_width, camera_height) = (c.width, c.height);
            return Err(BoardError::CameraSize { width, height, camera_width, camera_height });
        }
        let top = stretch(gray).ok_or_else(|| BoardError::not_found("the image is black"))?;
        let pixels = Pixels { data: gray, width, height };

        // Markers that are small against the image may vanish in the reduced one: then try a finer one.
        let mut factor = ((width * height) as f64 / COARSE_PIXELS as f64).sqrt().ceil().max(1.0) as usize;
        loop {
            let coarse = Decimated::new(gray, width, height, factor, top);
            match self.coarse(&coarse).and_then(|pairs| self.localize(&pixels, &pairs)) {
                Err(BoardError::NotFound { .. }) if factor > 1 => factor /= 2,
                answer => return answer,
            }
        }
    }

    /// Finds the board's points to a pixel or two.
    fn coarse(&self, image: &Decimated) -> Result<Vec<Pair>, BoardError> {
        let markers = |m: &Matcher| markers::find(image, m, &self.layout.markers);
        match (&self.charuco, &self.matcher) {
            // The chessboard of a charuco board is the surer find; its markers alone also tell where it is.
            (Some(charuco), Some(m)) => charuco.find(image).or_else(|e| markers(m).map_err(|_| e)),
            (_, Some(m)) => markers(m),
            _ => chessboard::find(image, self.layout.squares.as_ref().expect("a board has squares or markers")),
        }
    }

    /// Localizes every corner of the board to a small part of a pixel.
    fn localize(&self, pixels: &Pixels, pairs: &[Pair]) -> Result<Sighting, BoardError> {
        let camera = self.camera.as_ref();
        let lost = || BoardError::not_found(format!("the {} points seen lie on no plane", pairs.len()));
        let mut warp = Warp::fit(pairs, camera, pixels).ok_or_else(lost)?;
        let mut found = refine::corners(pixels, &self.corners, &warp, None);
        // Once more from where they are, with strips fitting the blur; and again if that brought in many that were too
        // far off.
        for _ in 0..3 {
            let pairs: Vec<Pair> = found.iter().map(|c| (c.corner.board_mm, c.corner.px)).collect();
            let Some(better) = Warp::fit(&pairs, camera, pixels) else { break };
            warp = better;
            found = refine::corners(pixels, &self.corners, &warp, refine::conditions(pixels, &found).as_ref());
            if found.len() * 10 <= pairs.len() * 11 {
                break;
            }
        }
        // Edges alone do not tell one square of a board from the next.
        if let Some(r) = agreement(pixels, &self.layout.markers, &self.artwork, &warp)
            && r < MIN_AGREEMENT
        {
            return Err(BoardError::not_found(format!(
                "a board was seen, but not this one: its markers agree with the print to {r:.2} of 1"
            )));
        }
        if found.len() < 4 {
            return Err(BoardError::not_found(format!(
                "{} points of it were seen, but only {} corners could be localized: the others are \
                 hidden, clipped (overexposed) or too blurred",
                pairs.len(),
                found.len()
            )));
        }
        let [sx, sy] = self.layout.scale;
        let real = |c: Corner| Corner { board_mm: [c.board_mm[0] * sx, c.board_mm[1] * sy], ..c };
        let blur_px = refine::blur(&found).expect("corners were found");
        Ok(Sighting { corners: found.into_iter().map(|c| real(c.corner)).collect(), blur_px })
    }
}

impl std::fmt::Debug for Detector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Detector").field("layout", &self.layout).finish_non_exhaustive()
    }
}

/// Checked at compile time: one detector serves all threads.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<Detector>();
    shared::<CharucoDetector>();
};
