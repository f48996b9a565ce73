//! The report of a calibration.

use nelu3d_scan::pose::Trajectory;
use serde::Serialize;

use super::fringes::CarriedReport;
use super::judge::DepthSpan;
use super::pose_refinement::PoseRefinement;
use crate::color_field::Quality;
use crate::progress::StageTime;
use crate::verdict::Judgment;

/// The report of a calibration, besides the color field.
#[derive(Clone, Debug, Serialize)]
pub struct CalibrationReport {
    /// Whether to trust the field, and what that rests on.
    #[serde(flatten)]
    pub judgment: Judgment,
    /// Depths that the boards span, mm; `None` for a field from a projector.
    pub boards_mm: Option<DepthSpan>,
    /// Root mean square reprojection error of the boards' corners, px; `None` where poses were known beforehand.
    pub corner_rms_px: Option<f64>,
    /// Board poses, position by position; `None` for a field from a projector.
    pub trajectory: Option<Trajectory>,
    /// Center of the light in the camera's frame, mm; `None` if it was not found or lies at infinity.
    pub light_mm: Option<[f64; 3]>,
    /// Quality of the field's predictions at held-out positions.
    pub quality: Option<Quality>,
    /// Center of the frame, and why, in words.
    pub frame: String,
    /// Why the field stays more than 3 dB below what noise allows, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortfall: Option<String>,
    /// Positions of which a part is not used, because it does not fit the other positions, and that fraction of the
    /// image.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub excluded: Vec<(String, f64)>,
    /// How far boards were moved to where the field of the others says that they are; absent where the corners' poses
    /// were kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refined_poses: Option<PoseRefinement>,
    /// Rays of light that no bright sample has met, and whose codeword is that of the same stripe beside them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carried: Option<CarriedReport>,
    /// Number of cells of the field along a, b and w.
    pub cells: [usize; 3],
    /// Wall and CPU time of each stage, in order.
    pub stages: Vec<StageTime>,
}
