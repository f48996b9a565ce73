//! The keys of rig.toml, and how a rig is put into them.

use serde::{Deserialize, Serialize};

use crate::board::{Board, BoardKind, Marker};
use crate::rig::Rig;

/// The newest version of the layout that is understood.
pub(in crate::rig) const FORMAT: i64 = 1;

/// The whole of rig.toml.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::rig) struct RigToml {
    pub(in crate::rig) format: i64,
    #[serde(default)]
    pub(in crate::rig) name: String,
    pub(in crate::rig) camera: CameraToml,
    #[serde(default)]
    pub(in crate::rig) images: ImagesToml,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::rig) pattern_sets: Vec<PatternSetToml>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) board: Option<BoardToml>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::rig) poses: Vec<PoseToml>,
}

/// The table `[camera]`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::rig) struct CameraToml {
    #[serde(default = "default_intrinsics")]
    pub(in crate::rig) intrinsics: String,
    pub(in crate::rig) channels: String,
    pub(in crate::rig) black_level: f64,
    pub(in crate::rig) saturation: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) response: Option<String>,
}

fn default_intrinsics() -> String {
    "camera.json".into()
}

/// The table `[images]`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(in crate::rig) struct ImagesToml {
    pub(in crate::rig) white: String,
    pub(in crate::rig) black: String,
}

impl Default for ImagesToml {
    fn default() -> Self {
        Self { white: "white.png".into(), black: "black.png".into() }
    }
}

/// One of `[[pattern_sets]]`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::rig) struct PatternSetToml {
    pub(in crate::rig) name: String,
    pub(in crate::rig) images: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::rig) inverse: Vec<String>,
}

/// The table `[board]`, with the keys of all kinds of board: which keys a kind has is checked by hand, which gives
/// better messages than an enum.
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::rig) struct BoardToml {
    pub(in crate::rig) kind: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) columns: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) rows: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) square_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) marker_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) dictionary: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) legacy: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) scale: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) extent_mm: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::rig) markers: Option<Vec<Marker>>,
}

/// One of `[[poses]]`: a Rodrigues vector (radians) and a translation (mm).
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::rig) struct PoseToml {
    pub(in crate::rig) position: String,
    pub(in crate::rig) rotation: [f64; 3],
    pub(in crate::rig) translation: [f64; 3],
}

/// Describes a rig as rig.toml does.
pub(super) fn to_toml(rig: &Rig) -> RigToml {
    RigToml {
        format: FORMAT,
        name: rig.name.clone(),
        camera: CameraToml {
            intrinsics: rig.camera_file.clone(),
            channels: rig.channels.name(),
            black_level: rig.black_level,
            saturation: rig.saturation,
            response: rig.response.as_ref().map(|r| r.name().to_owned()),
        },
        images: ImagesToml { white: rig.white.clone(), black: rig.black.clone() },
        pattern_sets: rig
            .pattern_sets
            .iter()
            .map(|s| PatternSetToml { name: s.name.clone(), images: s.images.clone(), inverse: s.inverse.clone() })
            .collect(),
        board: rig.board.as_ref().map(board_to_toml),
        poses: rig
            .poses
            .iter()
            .map(|p| PoseToml {
                position: p.position.clone(),
                rotation: p.cam_from_board.rotation.scaled_axis().into(),
                translation: p.cam_from_board.translation.vector.into(),
            })
            .collect(),
    }
}

/// Describes a board; its extent only where it is not that of the print.
pub(super) fn board_to_toml(board: &Board) -> BoardToml {
    let extent_mm = (board.extent_mm != bounding_box_mm(&board.kind, board.scale)).then_some(board.extent_mm);
    let scale = (board.scale != [1.0, 1.0]).then_some(board.scale);
    match board.kind.clone() {
        BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy } => BoardToml {
            kind: "charuco".into(),
            columns: Some(columns),
            rows: Some(rows),
            square_mm: Some(square_mm),
            marker_mm: Some(marker_mm),
            dictionary: Some(dictionary),
            legacy: Some(legacy),
            scale,
            extent_mm,
            markers: None,
        },
        BoardKind::Chessboard { columns, rows, square_mm } => BoardToml {
            kind: "chessboard".into(),
            columns: Some(columns),
            rows: Some(rows),
            square_mm: Some(square_mm),
            scale,
            extent_mm,
            ..BoardToml::default()
        },
        BoardKind::Markers { dictionary, markers } => BoardToml {
            kind: "markers".into(),
            dictionary: Some(dictionary),
            scale,
            extent_mm,
            markers: Some(markers),
            ..BoardToml::default()
        },
    }
}

/// Returns the outline of a board that states none, as printed: that of its squares, or of its markers.
pub(super) fn bounding_box_mm(kind: &BoardKind, [sx, sy]: [f64; 2]) -> [f64; 4] {
    let [x0, y0, x1, y1] = kind.bounding_box_mm();
    [x0 * sx, y0 * sy, x1 * sx, y1 * sy]
}
