//! Whether to trust a reconstruction: its captures, and how well the field explains what was measured.

mod ends;
#[doc(hidden)]
pub mod odd_pattern;
#[doc(hidden)]
pub mod response;

use nelu3d_scan::statistics::median;

use super::scene::Scene;
use crate::color_field::LightMotion;
use crate::sensor::{
    CodewordStatistics, Measurements, PatternStatistics, SurfaceEvidence, edges, judge_clipping, judge_codewords,
    judge_explained, judge_patterns,
};
use crate::surface::PixelStatus;
use crate::verdict::{Code, Finding, Judgment, Verdict};
use odd_pattern::OddPattern;

/// Most pixels that are compared with the field.
const MAX_PIXELS: usize = 6000;
/// Most pixels whose patterns are compared with each other.
const MAX_OF_PATTERNS: usize = 1500;
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
    judgment.extend(disagreeing(scene, |i| depth[i].is_finite()));
    judgment.extend(response::judge(scene, depth));
    judgment.extend(chi2.and_then(|chi2| residual(depth, chi2)));
    let surface = SurfaceEvidence { cut_by_volume: ends::cut_by_volume(scene, depth), unsupported };
    judgment.extend(judge_explained(&m.status, Some(surface)));
    judgment.extend(of_field(&metadata.warnings));
    judgment.extend(of_corrected_field(&metadata.corrected));
    judgment
}

/// Whether an image shows another pattern than its own: by what is measured alone, or by what of the lit pixels without
/// a depth is explained without it.
pub(super) fn disagreeing(scene: &Scene<'_>, has_depth: impl Fn(usize) -> bool) -> Option<Finding> {
    let (m, images) = (&scene.measurements, &scene.field.metadata.images);
    let is_seen = |i: usize| {
        let [near, far] = scene.rays.range[i];
        near < far && !matches!(m.status[i], PixelStatus::Underexposed | PixelStatus::Saturated)
    };
    let seen: Vec<usize> = (0..m.n()).filter(|i| is_seen(*i)).collect();
    let pixels: Vec<usize> = seen.iter().copied().step_by(seen.len().div_ceil(MAX_OF_PATTERNS).max(1)).collect();
    let value = |j: usize| if m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN };
    let measured: Vec<f32> = pixels.iter().flat_map(|i| (i * m.k..(i + 1) * m.k).map(value)).collect();
    let of_scene = PatternStatistics::new(&measured, m.k);
    let of_field = PatternStatistics::new(&along_rays(scene, &pixels), m.k);
    judge_patterns((&of_scene, &edges_of_scene(m, is_seen)), (&of_field, &edges_of_field(scene)), images)
        .or_else(|| OddPattern::of(scene, has_depth).and_then(|odd| odd.judge(images)))
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
    let found: Vec<usize> = pixels.iter().copied().filter(|i| depth[*i].is_finite()).collect();
    let is_found = found.len() as f64 > FOUND * pixels.len() as f64;
    let step = (pixels.len() / MAX_PIXELS).max(1);
    let codewords = if is_found {
        let at_surface = found.into_iter().step_by(step).flat_map(|i| {
            let mut c = vec![0.0; scene.measurements.k];
            let t = f64::from(depth[i] / scene.rays.dir_z(i));
            scene.grid.eval(scene.rays.in_frame(i).at(t).q, &mut c);
            c
        });
        at_surface.collect()
    } else {
        along_rays(scene, &pixels.iter().copied().step_by(step).collect::<Vec<_>>())
    };
    (!codewords.is_empty()).then(|| CodewordStatistics::new(&codewords, scene.measurements.k))
}

/// Lines of an image and of a field along which edges are counted.
const LINES: usize = 8;

/// Mean number of edges of every channel along rows and along columns of an image, where they show much of what is seen.
fn edges_of_scene(m: &Measurements, is_seen: impl Fn(usize) -> bool) -> Vec<[f64; 2]> {
    let size = [m.width, m.height];
    let mut means = vec![[0.0; 2]; m.k];
    for way in 0..2 {
        let pixel = |line: usize, at: usize| if way == 0 { line * m.width + at } else { at * m.width + line };
        let seen = |line: &usize| (0..size[way]).filter(|at| is_seen(pixel(*line, *at))).count();
        let mut lines: Vec<(usize, usize)> =
            (0..size[1 - way]).map(|line| (seen(&line), line)).filter(|(seen, _)| *seen > 0).collect();
        lines.sort_unstable_by(|a, b| b.cmp(a));
        lines.truncate(lines.len().div_ceil(2));
        let step = lines.len().div_ceil(LINES).max(1);
        let chosen: Vec<usize> = lines.into_iter().step_by(step).map(|(_, line)| line).collect();
        for line in &chosen {
            let value = |i: usize| {
                let is_seen = is_seen(i);
                (i * m.k..(i + 1) * m.k).map(move |j| if is_seen && m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN })
            };
            let values: Vec<f32> = (0..size[way]).flat_map(|at| value(pixel(*line, at))).collect();
            let counts = edges(&values, m.k);
            means.iter_mut().zip(counts).for_each(|(mean, n)| mean[way] += f64::from(n) / chosen.len() as f64);
        }
    }
    means
}

/// Mean number of edges of every channel of the field along its two axes across the light, where it is calibrated: on
/// lines in the middle along the light.
fn edges_of_field(scene: &Scene<'_>) -> Vec<[f64; 2]> {
    let (k, valid) = (scene.measurements.k, &scene.field.validity);
    let mut means = vec![[0.0; 2]; k];
    let mut c = vec![0.0; k];
    for (axis, line) in (0..2).flat_map(|axis| (0..LINES).map(move |line| (axis, line))) {
        let beside = (line as f32 + 0.5) / LINES as f32;
        let n = scene.grid.cells[axis];
        let mut values = Vec::with_capacity(n * k);
        for i in 0..n {
            let at = (i as f32 + 0.5) / n as f32;
            let q = if axis == 0 { [at, beside, 0.5] } else { [beside, at, 0.5] };
            if valid.is_lit(q) {
                scene.grid.eval(q, &mut c);
            } else {
                c.fill(f32::NAN);
            }
            values.extend_from_slice(&c);
        }
        means.iter_mut().zip(edges(&values, k)).for_each(|(mean, n)| mean[axis] += f64::from(n) / LINES as f64);
    }
    means
}

/// What codewords the field has along the rays of `pixels`, at any depth.
fn along_rays(scene: &Scene<'_>, pixels: &[usize]) -> Vec<f32> {
    let mut codewords = Vec::new();
    let mut c = vec![0.0; scene.measurements.k];
    for i in pixels {
        let (ray, [near, far]) = (scene.rays.in_frame(*i), scene.rays.range[*i]);
        for n in (0..DEPTHS).filter(|_| near < far) {
            let t = near + (far - near) * (n as f32 + 0.5) / DEPTHS as f32;
            scene.grid.eval(ray.at(f64::from(t)).q, &mut c);
            codewords.extend_from_slice(&c);
        }
    }
    codewords
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
