//! What columns can name: the keys of the answers that they look into.
//!
//! An experiment runs for hours, so that a misspelled path must be found before. Where a part of an answer depends on
//! the method, any path into it is let pass.

use anyhow::{Result, bail};
use nelu3d_evaluate::cad::CadErrors;
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, compare, evaluate};
use nelu3d_scan::{Camera, Projector};
use serde_json::{Value, json};

/// Stands for a part of an answer whose keys depend on the method.
const ANY: &str = "*";

/// Fails if the path of a column leads to no number of any answer.
pub(super) fn check(path: &str) -> Result<()> {
    let mut at = &known();
    let mut walked = String::new();
    for key in path.split('.') {
        match at {
            Value::Object(keys) => match keys.get(key) {
                Some(next) => at = next,
                None => {
                    let keys: Vec<&str> = keys.keys().map(String::as_str).collect();
                    let place = if walked.is_empty() { "an answer".to_owned() } else { format!("`{walked}`") };
                    bail!("`{path}` is no value: {place} has no `{key}`; it has {}", keys.join(", "));
                }
            },
            Value::String(any) if any == ANY => return Ok(()),
            _ => bail!("`{path}` is no value: `{walked}` has no parts; leave `.{key}` away"),
        }
        walked = if walked.is_empty() { key.to_owned() } else { format!("{walked}.{key}") };
    }
    match at {
        Value::Object(keys) => {
            let keys: Vec<&str> = keys.keys().map(String::as_str).collect();
            bail!("`{path}` is no number; go on with one of its parts: {}", keys.join(", "))
        }
        _ => Ok(()),
    }
}

/// Returns all keys that any answer has. What is written as types is made of them, so that it cannot grow old; the rest
/// is held by a test against an experiment that runs.
fn known() -> Value {
    let metrics = serde_json::to_value(metrics()).expect("metrics are plain data");
    let errors = serde_json::to_value(CadErrors::of(vec![])).expect("errors are plain data");
    json!({
        // result.json of one result, and the means over a sequence's frames.
        "result": {
            "cpu_secs": 0, "wall_secs": 0, "peak_memory_bytes": 0, "kept": 0, "format": 0,
            "metrics": metrics, "pixels": ANY, "depth_mm": ANY, "mesh": ANY, "method": ANY, "motion": ANY, "start": ANY,
            "machine": ANY, "camera": ANY, "trust": ANY, "verdict": ANY, "warnings": ANY,
        },
        "calibrate": {
            "field_bytes": 0, "cpu_secs": 0, "peak_memory_bytes": 0, "mixing": ANY,
            "trust": ANY, "verdict": ANY, "warnings": ANY,
            "report": {
                "trajectory": ANY, "quality": {
                    "n": 0, "psnr_db": 0, "psnr_all_db": 0, "ceiling_db": 0, "depth_mm": 0, "pose_mm": 0,
                },
                "trust": ANY, "verdict": ANY, "warnings": ANY,
            },
        },
        "step": { "wall_secs": 0, "calibrate_wall_secs": 0 },
        "cad": {
            "color_scale_mm": ANY,
            "metrics": {
                "scale": 0, "cad_diagonal_mm": 0, "within_mm": 0, "n_points": 0, "inliers": 0, "visible_found": 0,
                "in_front": 0, "all": errors, "part": errors, "body": errors,
            },
        },
        "against": serde_json::to_value(compare(&[], &[])).expect("a comparison is plain data"),
    })
}

/// Evaluates a picture of a few pixels against itself, for the keys of what comes out.
fn metrics() -> nelu3d_evaluate::Metrics {
    const SIDE: usize = 4;
    let camera = Camera::pinhole(SIDE, SIDE, 5.0, 5.0, 1.5, 1.5);
    let (depth, normals, sigma) = ([500.0; SIDE * SIDE], [[0.0, 0.0, -1.0]; SIDE * SIDE], [0.1; SIDE * SIDE]);
    let truth = GroundTruth { width: SIDE, height: SIDE, depth: depth.to_vec(), mask: vec![true; SIDE * SIDE] };
    let projector =
        Projector { optics: camera.clone(), proj_from_cam: nalgebra::Isometry3::translation(-9.0, 0.0, 0.0) };
    let maps = EvaluatedMaps { depth: &depth, normals: Some(&normals), sigma: Some(&sigma) };
    evaluate(&maps, &truth, &truth.regions(&camera), &camera, Some(&projector))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelled_columns_are_named() {
        for good in [
            "result.metrics.whole.depth_mm.mae",
            "result.metrics.body.sigma.within_1",
            "result.metrics.whole.disparity_px.mae",
            "result.metrics.n_outside_mask",
            "result.method.crosstalk.anything",
            "result.motion.pattern_time.frames",
            "calibrate.report.quality.psnr_db",
            "cad.metrics.all.distance_mm.rmse",
            "against.depth_mm.mae",
            "step.wall_secs",
        ] {
            check(good).unwrap_or_else(|e| panic!("{good}: {e}"));
        }
        for (bad, says) in [
            (
                "result.metrics.hole.depth_mm.mae",
                "`result.metrics` has no `hole`; it has body, grazing, n_outside_mask",
            ),
            ("reslut.cpu_secs", "an answer has no `reslut`; it has against, cad"),
            ("result.metrics.whole.depth_mm", "go on with one of its parts: bias"),
            ("step.wall_secs.mean", "leave `.mean` away"),
            ("", "an answer has no ``"),
        ] {
            let e = check(bad).unwrap_err().to_string();
            assert!(e.contains(says), "{e} instead of {says}");
        }
    }
}
