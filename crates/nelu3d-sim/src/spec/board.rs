//! The board of the sweep, as rig.toml spells it.

use nelu3d_scan::board::{Board, BoardKind, Marker};
use serde::{Deserialize, Serialize};

use super::axis::AxisSpec;
use super::defaults::y_axis;

/// A smooth bend of the physical board to a part of a cylinder. rig.toml still says that it is flat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardBendSpec {
    /// Height of the arc over its chord, mm; positive: the middle stands out toward the camera. The middle stays at the
    /// position's pose.
    pub sagitta_mm: f64,
    /// Axis of the board that stays straight: x or y.
    #[serde(default = "y_axis")]
    pub axis: AxisSpec,
}

/// A curled corner of the physical board, that at (x_max, y_max). rig.toml still says that the board is flat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardCurlSpec {
    /// How far the corner stands out toward the camera, mm; between it and where the curl begins, with the square of
    /// the distance.
    pub height_mm: f64,
    /// Where the curl begins, mm before the corner, along the diagonal.
    pub length_mm: f64,
}

/// The flat target of the sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum BoardSpec {
    /// A chessboard with ArUco markers in its white squares.
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
        #[serde(default)]
        legacy: bool,
        /// Outline `[x_min, y_min, x_max, y_max]`, mm; the smallest around the print unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        extent_mm: Option<[f64; 4]>,
    },
    /// A plain chessboard.
    Chessboard {
        /// Squares along x.
        columns: usize,
        /// Squares along y.
        rows: usize,
        /// Side of a square, mm.
        square_mm: f64,
        /// Outline `[x_min, y_min, x_max, y_max]`, mm; the smallest around the print unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        extent_mm: Option<[f64; 4]>,
    },
    /// ArUco markers on white.
    Markers {
        /// OpenCV's name of a predefined dictionary.
        dictionary: String,
        /// The markers.
        markers: Vec<Marker>,
        /// Outline `[x_min, y_min, x_max, y_max]`, mm; the smallest around the print unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        extent_mm: Option<[f64; 4]>,
    },
}

impl BoardSpec {
    /// Returns the outline `[x_min, y_min, x_max, y_max]`, mm.
    pub fn extent_mm(&self) -> [f64; 4] {
        self.board().extent_mm
    }

    /// Returns the board in the form that rigs and detectors use.
    pub fn board(&self) -> Board {
        let (kind, extent_mm) = match self.clone() {
            BoardSpec::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy, extent_mm } => {
                (BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy }, extent_mm)
            }
            BoardSpec::Chessboard { columns, rows, square_mm, extent_mm } => {
                (BoardKind::Chessboard { columns, rows, square_mm }, extent_mm)
            }
            BoardSpec::Markers { dictionary, markers, extent_mm } => {
                (BoardKind::Markers { dictionary, markers }, extent_mm)
            }
        };
        let extent_mm = extent_mm.unwrap_or_else(|| kind.bounding_box_mm());
        Board { kind, extent_mm, scale: [1.0, 1.0] }
    }
}
