//! Whether to trust a reconstruction: its captures, and how well the field explains what was measured.

mod along_rays;
mod ends;
mod missed_pattern;
#[doc(hidden)]
pub mod odd_pattern;
#[doc(hidden)]
pub mod response;

use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::scene::Scene;
use crate::color_field::LightMotion;
use crate::sensor::{CodewordStatistics, Support, SurfaceEvidence, judge_clipping, judge_codewords, judge_explained};
use crate::verdict::{Code, Finding, Judgment, Verdict};
use along_rays::along_rays;
pub(super) use missed_pattern::disagreeing;

/// Most pixels that are compared with the field.
const MAX_PIXELS: usize = 6000;

/// Judges a surface of `scene`: its depth (camera z, mm; NaN where there is none), and χ² per measurement where the
/// recipe knows it. `support` is what supports the surface beside its own fit, where that is known. The status of every
/// pixel is that of the scene's measurements.
pub(super) fn judge(scene: &Scene<'_>, depth: &[f32], chi2: Option<&[f32]>, support: Option<Support>) -> Judgment {
    let (m, metadata) = (&scene.measurements, &scene.field.metadata);
    let mut judgment = Judgment::default();
    judgment.extend(judge_clipping(&m.status));
    let (statistics, pixels) = CodewordStatistics::of_scene(m, &m.status);
    let chi2 = chi2.and_then(|chi2| median_chi2(depth, chi2));
    let surface = SurfaceEvidence { cut_by_volume: ends::cut_by_volume(scene, depth), chi2, support };
    let expected = expected(scene, &pixels, depth, surface.is_supported());
    judgment.extend(judge_codewords(&statistics, expected.as_ref(), &metadata.images));
    judgment.extend(disagreeing(scene, |i| depth[i].is_finite()));
    judgment.extend(response::judge(scene, depth));
    judgment.extend(chi2.and_then(residual));
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

/// What codewords the field has where the surface was found, if it was found at most of `pixels`, or is supported by
/// more than its fit: an object may lie within one stripe of a coarse code. Else along their rays, at any depth. `None`
/// where no ray meets the field's volume.
fn expected(scene: &Scene<'_>, pixels: &[usize], depth: &[f32], is_supported: bool) -> Option<CodewordStatistics> {
    /// Fraction of the pixels with a depth from which the surface counts as found.
    const FOUND: f64 = 0.5;
    let found: Vec<usize> = pixels.iter().copied().filter(|i| depth[*i].is_finite()).collect();
    let is_found = is_supported || found.len() as f64 > FOUND * pixels.len() as f64;
    let step = (pixels.len() / MAX_PIXELS).max(1);
    let codewords = if is_found {
        let at_surface = found.par_iter().step_by(step).flat_map_iter(|i| {
            let mut c = vec![0.0; scene.measurements.k];
            let t = f64::from(depth[*i] / scene.rays.dir_z(*i));
            scene.grid.eval(scene.rays.in_frame(*i).at(t).q, &mut c);
            c
        });
        at_surface.collect()
    } else {
        along_rays(scene, &pixels.iter().copied().step_by(step).collect::<Vec<_>>())
    };
    (!codewords.is_empty()).then(|| CodewordStatistics::new(&codewords, scene.measurements.k))
}

/// Returns the median χ² per measurement over the surface; `None` where there is no surface.
pub fn median_chi2(depth: &[f32], chi2: &[f32]) -> Option<f64> {
    let mut known: Vec<f32> = (0..depth.len()).filter(|i| depth[*i].is_finite()).map(|i| chi2[i]).collect();
    median(&mut known).map(f64::from)
}

/// Judges the median χ² per measurement over the surface: about 1 where field and noise are what they are taken for.
pub fn residual(median_chi2: f64) -> Option<Finding> {
    /// Median χ² per measurement that no good scene reaches.
    const MAX_CHI2: f64 = 3.0;
    (median_chi2 > MAX_CHI2).then(|| {
        let sentence = format!(
            "the scene's codewords differ from the field's by {:.1} times what noise and field allow",
            median_chi2.sqrt()
        );
        let remedy = "check that white, black and patterns are this scene's, linear, in the set's order and exposed as \
                      in the sweep, and that nothing moved";
        Finding::new(Code::ResidualAboveNoise, Verdict::Doubtful, sentence, remedy).with("median_chi2", median_chi2)
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
