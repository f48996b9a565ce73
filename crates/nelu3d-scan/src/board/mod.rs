//! The flat target of the calibration sweep: what is printed on it, and where its corners are in an image.
//!
//! [`Artwork`] answers what is printed at a point of the board, [`Detector`] finds the board's corners in an image.
//! Both read the same layout, so a board that one of them accepts means the same to the other; so does
//! [`mod@print`], which puts boards on paper.
//!
//! The board's frame: x to the right and y down as one looks at the print, z into the board, so that a board seen from
//! its front has a right-handed rotation into the camera's frame (OpenCV's convention). For the kinds made of squares,
//! the origin is the outer corner of the top-left square.

mod artwork;
mod detect;
mod dictionary;
mod error;
mod layout;
mod marker_frame;
pub mod print;

pub use artwork::Artwork;
pub use detect::{Detector, Sighting};
pub use dictionary::Dictionary;
pub use error::BoardError;

/// The flat target of a sweep. The board's frame has its plane at z = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// What is printed on it.
    pub kind: BoardKind,
    /// Outline `[x_min, y_min, x_max, y_max]`, mm. Pixels whose ray meets the plane outside it are not samples.
    pub extent_mm: [f64; 4],
    /// What the printer made of a length along x and along y, for one of 1: lengths of `kind` times this are real ones.
    pub scale: [f64; 2],
}

/// The kinds of board there are.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardKind {
    /// A chessboard with ArUco markers in its white squares; identifies its corners even when partly seen.
    Charuco {
        /// Squares along x.
        columns: usize,
        /// Squares along y.
        rows: usize,
        /// Side of a square, mm.
        square_mm: f64,
        /// Side of a marker, mm.
        marker_mm: f64,
        /// OpenCV's name of a predefined dictionary.
        dictionary: String,
        /// OpenCV's layout before 4.6.
        legacy: bool,
    },
    /// A plain chessboard; must be seen whole. Its top-left square is black. Where turning it by 180° (or 90°, if it is
    /// square) leaves the print unchanged, the origin is that of the turn whose x axis points furthest to the right in
    /// the image: such a board must not be turned further than that during a sweep.
    Chessboard {
        /// Squares along x.
        columns: usize,
        /// Squares along y.
        rows: usize,
        /// Side of a square, mm.
        square_mm: f64,
    },
    /// Any layout of ArUco markers.
    Markers {
        /// OpenCV's name of a predefined dictionary.
        dictionary: String,
        /// The markers.
        markers: Vec<Marker>,
    },
}

impl BoardKind {
    /// Returns whether the print is unchanged by a turn of 180°: images do not tell then which way around it was held.
    pub fn is_symmetric(&self) -> bool {
        matches!(self, BoardKind::Chessboard { columns, rows, .. } if (columns + rows).is_multiple_of(2))
    }

    /// Returns `[x_min, y_min, x_max, y_max]` of the squares or markers as described, mm.
    pub fn bounding_box_mm(&self) -> [f64; 4] {
        match self {
            BoardKind::Charuco { columns, rows, square_mm, .. }
            | BoardKind::Chessboard { columns, rows, square_mm } => {
                [0.0, 0.0, *columns as f64 * square_mm, *rows as f64 * square_mm]
            }
            BoardKind::Markers { markers, .. } => {
                let empty = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
                markers
                    .iter()
                    .flat_map(|m| m.corners_mm)
                    .fold(empty, |b, [x, y]| [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)])
            }
        }
    }
}

/// One ArUco marker on a board.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Marker {
    /// Its number in the dictionary.
    pub id: u32,
    /// Board coordinates of its corners, clockwise from the marker's own top-left, mm.
    pub corners_mm: [[f64; 2]; 4],
}

/// A corner of the board found in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Where it is on the board, mm (z = 0).
    pub board_mm: [f64; 2],
    /// Where it was seen, px.
    pub px: [f64; 2],
}
