//! Whether to trust a reconstruction: its captures, and how well the field explains what was measured.

mod ends;
#[doc(hidden)]
pub mod response;

use nelu3d_scan::statistics::median;

use super::scene::Scene;
use crate::color_field::LightMotion;
use crate::sensor::{CodewordStatistics, SurfaceEvidence, judge_clipping, judge_codewords, judge_explained};
use crate::verdict::{Code, Finding, Judgment, Verdict};

/// Most pixels that are compared with the field.
const MAX_PIXELS: usize = 6000;
/// Depths along a ray at which the field is asked what codewords there may be.
const DEPTHS: usize = 12;

/// Judges a surface of `scene`: its depth (camera z, mm; NaN where there is none), and χ² per measurement where the
/// recipe knows it. `unsupported` is the fraction of the surface that nothing but its own fit supports, where that is
/// known. The status of every pixel is that of the scene's measurements.
pub(super) fn judge(scene: &Scene<'_>, depth: &[f32], chi2: Option<&[f32]>, unsupported: Option<f64>) -> Judgment {
    let (m, metadata) = (&scene.measurements, &scene.field.metadata);
    let mut judgment = Judgment::default();
    judgment.extend(judge_clipping(&m.status));
    let (statistics, pixels) = CodewordStatistics::of_scene(m, &m.status);
    let expected = expected(scene, &pixels, depth);
    judgment.extend(judge_codewords(&statistics, expected.as_ref(), &metadata.images));
    judgment.extend(response::judge(scene, depth));
    judgment.extend(chi2.and_then(|chi2| residual(depth, chi2)));
    let surface = SurfaceEvidence { cut_by_volume: ends::cut_by_volume(scene, depth), unsupported };
    judgment.extend(judge_explained(&m.status, Some(surface)));
    judgment.extend(of_field(&metadata.warnings));
    judgment.extend(of_corrected_field(&metadata.corrected));
    judgment
}

/// Notes that a field was corrected.
fn of_corrected_field(corrected: &[LightMotion]) -> Option<Finding> {
    (!corrected.is_empty()).then(|| {
        let sentence = "the color field is corrected for a motion of camera or light since the sweep";
        Finding::new(Code::Drift, Verdict::Good, sentence, "calibrate again when there is time")
            .with("motions", serde_json::to_value(corrected).unwrap_or_default())
    })
}

/// Notes that nothing told whether camera or light moved since the sweep; `why` is a part of a sentence.
pub(super) fn drift_not_checked(why: &str) -> Finding {
    let sentence = format!("whether camera or projector moved since the sweep was not checked, as {why}");
    let remedy = "leave the board at the edge of the view, or let `nelu3d check --drift` look at it from time to time";
    Finding::new(Code::DriftNotChecked, Verdict::Good, sentence, remedy)
}

/// What codewords the field has where the surface was found, if it was found at most of `pixels`: an object may lie
/// within one stripe of a coarse code. Else along their rays, at any depth. `None` where no ray meets the field's
/// volume.
fn expected(scene: &Scene<'_>, pixels: &[usize], depth: &[f32]) -> Option<CodewordStatistics> {
    /// Fraction of the pixels with a depth from which the surface counts as found.
    const FOUND: f64 = 0.5;
    let k = scene.measurements.k;
    let is_found = |i: &usize| depth[*i].is_finite();
    let found = pixels.iter().filter(|i| is_found(i)).count() as f64 > FOUND * pixels.len() as f64;
    let mut codewords = Vec::new();
    let mut c = vec![0.0; k];
    for i in pixels.iter().filter(|i| !found || is_found(i)).step_by((pixels.len() / MAX_PIXELS).max(1)) {
        let ray = scene.rays.in_frame(*i);
        let mut add = |t: f32| {
            scene.grid.eval(ray.at(f64::from(t)).q, &mut c);
            codewords.extend_from_slice(&c);
        };
        let [near, far] = scene.rays.range[*i];
        if found {
            add(depth[*i] / scene.rays.dir_z(*i));
        } else if near < far {
            (0..DEPTHS).for_each(|n| add(near + (far - near) * (n as f32 + 0.5) / DEPTHS as f32));
        }
    }
    (!codewords.is_empty()).then(|| CodewordStatistics::new(&codewords, k))
}

/// Judges χ² per measurement over the surface: about 1 where field and noise are what they are taken for.
pub fn residual(depth: &[f32], chi2: &[f32]) -> Option<Finding> {
    /// Median χ² per measurement that no good scene reaches.
    const MAX_CHI2: f64 = 3.0;
    let mut known: Vec<f32> = (0..depth.len()).filter(|i| depth[*i].is_finite()).map(|i| chi2[i]).collect();
    let median = f64::from(median(&mut known)?);
    tracing::debug!(median, "χ² per measurement");
    (median > MAX_CHI2).then(|| {
        let sentence = format!(
            "the scene's codewords differ from the field's by {:.1} times what noise and field allow",
            median.sqrt()
        );
        let remedy = "check that white, black and patterns are this scene's, linear, in the set's order and exposed as \
                      in the sweep, and that nothing moved";
        Finding::new(Code::ResidualAboveNoise, Verdict::Doubtful, sentence, remedy).with("median_chi2", median)
    })
}

/// A field of a doubtful calibration makes doubtful surfaces.
pub fn of_field(warnings: &[String]) -> Option<Finding> {
    (!warnings.is_empty()).then(|| {
        let sentence = format!("the color field's calibration was not good ({})", warnings.join(", "));
        Finding::new(
            Code::FieldDoubtful,
            Verdict::Doubtful,
            sentence,
            "see what `nelu3d calibrate` says, and repeat it",
        )
        .with("codes", warnings.to_vec())
    })
}
