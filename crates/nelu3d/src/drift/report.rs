//! What a check for drift found.

use serde::Serialize;

use crate::color_field::LightMotion;
use crate::verdict::{Code, Finding, Verdict};

/// What moved since the sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Moved {
    /// Nothing that the codewords would show.
    Nothing,
    /// The light source: the board, left in place, is where it was, and its codewords are others.
    Light,
    /// The camera: the board, left in place, is elsewhere in the image, and carries the codewords that it carried.
    Camera,
    /// One of them against the other; the board stands elsewhere than in the sweep, so that which cannot be told.
    Unknown,
}

/// What a check for drift found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriftReport {
    /// What moved.
    pub moved: Moved,
    /// How far the light's pattern moved on the boards as the camera sees it, root mean square, px.
    pub shift_px: f64,
    /// Mean shift of the light's pattern on the boards as the camera sees it, along the image's x and y, px.
    pub direction_px: [f64; 2],
    /// The motion of the light in the camera's frame that explains the codewords.
    pub motion: LightMotion,
    /// Whether a rigid motion explains what changed.
    pub rigid: bool,
    /// Median χ² per measurement without that motion.
    pub chi2_still: f64,
    /// Median χ² per measurement with it.
    pub chi2_moved: f64,
    /// Root mean square reprojection error of the board's corners, px, the largest of all views.
    pub corner_rms_px: f64,
    /// Position of the sweep at which the board seems to stand.
    pub position: Option<String>,
    /// Median displacement of the corners since then along x and y, px.
    pub corners_px: Option<[f64; 2]>,
}

impl DriftReport {
    /// Returns the finding: a warning if something moved, `None` if not.
    pub fn finding(&self) -> Option<Finding> {
        let remedy = if self.rigid {
            "calibrate again, or let `nelu3d reconstruct --correct` take the motion into account"
        } else {
            "calibrate again; check focus, zoom, the patterns and their order"
        };
        (self.moved != Moved::Nothing).then(|| {
            Finding::new(Code::Drift, Verdict::Doubtful, format!("{}{}", self.what(), self.rest()), remedy)
                .with("moved", serde_json::to_value(self.moved).unwrap_or_default())
                .with("shift_px", self.shift_px)
                .with("direction_px", self.direction_px.to_vec())
                .with("chi2_still", self.chi2_still)
                .with("chi2_moved", self.chi2_moved)
                .with("corners_px", self.corners_px.map(|c| c.to_vec()))
        })
    }

    /// Says what moved.
    fn what(&self) -> String {
        let who = match self.moved {
            Moved::Nothing => return "neither camera nor light moved since the sweep".into(),
            Moved::Light => "the light source moved since the sweep",
            Moved::Camera => "the camera moved since the sweep",
            Moved::Unknown => "camera or light source moved since the sweep",
        };
        if self.rigid {
            let (px, toward) = (self.shift_px, toward(self.direction_px));
            return format!("{who}: the pattern falls {px:.1} px {toward}of where it should on the board");
        }
        format!("{who}, and by more than a small rigid motion, or something else changed")
    }

    /// Says what cannot be told.
    fn rest(&self) -> &'static str {
        match self.moved {
            Moved::Unknown if self.rigid => " (which of them is told by a board at one of its places of the sweep)",
            _ => "",
        }
    }
}

/// Returns the direction of a shift in words, with a space after them.
fn toward([x, y]: [f64; 2]) -> &'static str {
    match (x.abs() > y.abs(), x > 0.0, y > 0.0) {
        (true, true, _) => "to the right ",
        (true, false, _) => "to the left ",
        (false, _, true) => "below ",
        (false, _, false) => "above ",
    }
}
