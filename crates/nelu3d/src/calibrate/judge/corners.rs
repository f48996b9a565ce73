//! What the corners tell: how well they fit, and whether their misfit has a cause that all positions share.

use nelu3d_scan::pose::{Explanation, SharedCause, SharedMisfit};

use crate::verdict::{Code, Finding, Verdict};

/// Fraction of the corners' sum of squares that a cause takes away at least, to be one. Corners of a good rig have
/// errors of their own in common (ink that spreads, edges that the pixels sample alike), of their own shape.
const MIN_SHARE: f64 = 0.3;
/// F statistic from which a cause is no chance, whatever the number of corners.
const MIN_F: f64 = 30.0;
/// Change of depth that a cause makes, as a fraction of the depth, from which it matters.
const MIN_DEPTH: f64 = 3e-4;
/// Root mean square reprojection error that no sound set-up exceeds, px.
const MAX_RMS_PX: f64 = 0.7;

/// Judges the misfit of the corners of boards about `depth_mm` away.
pub fn judge(misfit: Option<&SharedMisfit>, depth_mm: f64) -> Option<Finding> {
    let misfit = misfit?;
    tracing::debug!(?misfit, "corners");
    let is_cause = |e: &Explanation| e.share >= MIN_SHARE && e.f >= MIN_F && e.depth_mm >= MIN_DEPTH * depth_mm;
    let Some(best) = misfit.likeliest(is_cause) else {
        return (misfit.rms_px > MAX_RMS_PX).then(|| {
            let sentence = format!("the boards' corners fit to {:.2} px only", misfit.rms_px);
            let remedy = "check camera.json, the print's measures in [board], and that the images are sharp";
            Finding::new(Code::CornersMisfit, Verdict::Doubtful, sentence, remedy).with("corner_rms_px", misfit.rms_px)
        });
    };
    let (code, cause, remedy) = match best.cause {
        SharedCause::Intrinsics | SharedCause::Camera => (
            Code::CameraIntrinsics,
            "another focal length or principal point",
            "calibrate the camera again; camera.json may be of another camera, resolution, or focus",
        ),
        SharedCause::Distortion => (
            Code::CameraDistortion,
            "another lens distortion",
            "calibrate the camera with its distortion, and do not undistort the images",
        ),
        SharedCause::Print => (
            Code::PrintStretched,
            "a print that is stretched along one axis",
            "measure the print along both axes and correct [board] in rig.toml; `fit to page` stretches",
        ),
        SharedCause::Bend => (Code::BoardBent, "a bent board", "mount the print on something flat, and sweep again"),
    };
    let sentence = format!(
        "the boards' corners fit to {:.2} px, {cause} would explain {:.0} % of that and change depths by {:.1} mm",
        misfit.rms_px,
        100.0 * best.share,
        best.depth_mm
    );
    let finding = Finding::new(code, Verdict::Doubtful, sentence, remedy);
    Some(
        finding
            .with("corner_rms_px", misfit.rms_px)
            .with("explained_share", best.share)
            .with("depth_change_mm", best.depth_mm)
            .with("amount", best.amount)
            .with("f", best.f),
    )
}
