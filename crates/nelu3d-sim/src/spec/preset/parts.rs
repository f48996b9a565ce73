//! Parts that several presets share.

use nelu3d_scan::board::Marker;
use nelu3d_scan::pattern::{Axis, Pattern, Random, Sinusoid, Triangle};

use crate::spec::{AlbedoSpec, BoardSpec, ObjectSpec, PatternSetSpec, ShapeSpec};

/// Depth of the middle of every preset's volume, mm.
pub(super) const MIDDLE_MM: f64 = 700.0;

/// Colors that do not mix.
pub(super) const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The dictionary of all presets' markers.
const DICTIONARY: &str = "DICT_4X4_50";

/// Returns three patterns across a projector of `width_px` columns: a sinusoid of `period_px`, a triangle wave and a
/// random one.
pub(super) fn mixed_patterns(width_px: f64, period_px: f64, seed: u64) -> PatternSetSpec {
    let (min_period_px, max_period_px) = (width_px / 16.0, width_px / 2.0);
    PatternSetSpec {
        name: "mixed3".into(),
        patterns: vec![
            Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 1 }),
            Pattern::Triangle(Triangle { axis: Axis::X, period_px: width_px / 3.0 }),
            Pattern::Random(Random { axis: Axis::X, min_period_px, max_period_px, seed }),
        ],
    }
}

/// Returns a white board with a column of `rows` markers at its left and right edge. Markers have sides of `side_mm`,
/// one every `pitch_mm`, and end `edge_mm` beside the board's center; the outline is `half_mm` from it.
pub(super) fn marker_board(rows: u32, side_mm: f64, pitch_mm: f64, edge_mm: f64, half_mm: [f64; 2]) -> BoardSpec {
    let mut markers = Vec::new();
    for x in [-edge_mm, edge_mm - side_mm] {
        for row in 0..rows {
            let y = (f64::from(row) - 0.5 * f64::from(rows - 1)) * pitch_mm - side_mm / 2.0;
            let corners_mm = [[x, y], [x + side_mm, y], [x + side_mm, y + side_mm], [x, y + side_mm]];
            markers.push(Marker { id: markers.len() as u32, corners_mm });
        }
    }
    let [x, y] = half_mm;
    BoardSpec::Markers { dictionary: DICTIONARY.into(), markers, extent_mm: Some([-x, -y, x, y]) }
}

/// Returns a charuco board whose markers have three quarters of their squares' side.
pub(super) fn charuco_board(columns: usize, rows: usize, square_mm: f64) -> BoardSpec {
    BoardSpec::Charuco {
        columns,
        rows,
        square_mm,
        marker_mm: 0.75 * square_mm,
        dictionary: DICTIONARY.into(),
        legacy: false,
        extent_mm: None,
    }
}

/// Returns a vase with a foot, a belly, a neck and a lip, 128 mm high, its top leaning a little toward the camera.
pub(super) fn vase(albedo: AlbedoSpec) -> ObjectSpec {
    let shape = ShapeSpec::Vase {
        profile_mm: vec![
            [0.0, 25.0],
            [5.0, 24.0],
            [14.0, 20.5],
            [32.0, 33.0],
            [54.0, 41.0],
            [76.0, 32.0],
            [94.0, 18.5],
            [106.0, 16.0],
            [118.0, 20.0],
            [126.0, 26.0],
            [128.0, 27.0],
        ],
    };
    ObjectSpec { rotation: [0.12, 0.0, 0.0], albedo, ..ObjectSpec::new(shape, [0.0, 64.0, MIDDLE_MM + 5.0]) }
}
