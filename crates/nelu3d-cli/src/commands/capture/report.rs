//! What a capture did, for people and for machines.

use std::path::PathBuf;

use nelu3d_capture::{CaptureTiming, ExposureAdvice, FrameCounts, FrameNoise};
use nelu3d_scan::radiometry::ResponseReport;
use serde::Serialize;

use crate::paths::shown;

/// A measured response.
#[derive(Debug, Serialize)]
pub(super) struct ResponseSummary {
    /// Its name in rig.toml.
    pub(super) name: String,
    #[serde(flatten)]
    pub(super) report: ResponseReport,
}

/// What a capture did.
#[derive(Debug, Default, Serialize)]
pub(super) struct CaptureReport {
    pub(super) rig: PathBuf,
    /// Folders written.
    pub(super) written: Vec<PathBuf>,
    /// Folders that an earlier capture had written.
    pub(super) found: usize,
    /// What became of the frames.
    pub(super) frames: FrameCounts,
    pub(super) timing: Option<CaptureTiming>,
    pub(super) noise: Option<FrameNoise>,
    pub(super) exposure: Option<ExposureAdvice>,
    /// How the camera's codes follow light, where that was measured.
    pub(super) response: Option<ResponseSummary>,
    /// Whether the rig has intrinsics.
    pub(super) has_intrinsics: bool,
}

impl CaptureReport {
    /// Returns it for people.
    pub(super) fn text(&self) -> String {
        let mut text = format!("rig       {}\n", shown(&self.rig));
        let found = if self.found > 0 { format!(", {} were there", self.found) } else { String::new() };
        text += &format!("written   {} folders{found}\n", self.written.len());
        if let Some(timing) = self.timing {
            let ms = |secs: f64| 1e3 * secs;
            text += &format!(
                "timing    a frame every {:.0} ms; changes are seen after {:.0} to {:.0} ms\n",
                ms(timing.frame_secs),
                ms(timing.latency_min_secs),
                ms(timing.latency_max_secs)
            );
        }
        let n = self.frames;
        text += &format!(
            "frames    {} delivered, {} accepted; {} too early, {} stale, {} twice, {} torn or shaken, {} lost\n",
            n.delivered, n.accepted, n.early, n.stale, n.duplicated, n.lone, n.lost
        );
        if let Some(exposure) = self.exposure {
            text += &format!("exposure  {exposure}\n");
        }
        if let Some(response) = &self.response {
            text += &format!(
                "response  {}: about code^{:.2}, ± {:.2} %; light adds up to {:.2} %\n",
                response.name,
                response.report.gamma,
                response.report.standard_error_percent,
                response.report.adds_up_percent
            );
        }
        if !self.has_intrinsics {
            text += "next      the rig has no intrinsics yet: `nelu3d camera` makes camera.json\n";
        }
        text
    }
}
