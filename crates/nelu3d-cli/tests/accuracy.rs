//! The accuracy of the main path, from a virtual rig to a surface, with the default settings: what nobody may lose
//! unseen.
//!
//! Bounds lie a fifth above what was measured when they were set; whoever makes the method better lowers them.

mod common;

use std::path::Path;

use serde_json::Value;

use common::{nelu3d, stderr};

/// What a result must keep, against its ground truth.
struct Bounds {
    /// Median absolute error of depth where neither edges nor shadows are near, mm.
    body_median_mm: f64,
    /// Mean absolute error of all pixels that have depth, mm.
    whole_mae_mm: f64,
    /// Least share of the pixels that should have depth and do.
    coverage: f64,
    /// Share of pixels that are off by more than 1 mm.
    outliers: f64,
    /// Pixels with depth where there is no surface, as a share of those where there is.
    outside: f64,
}

fn ok(args: &[&str]) -> Value {
    let out = nelu3d(&[args, &["--quiet", "--json"]].concat());
    assert!(out.status.success(), "{args:?}: {}", stderr(&out));
    serde_json::from_slice(&out.stdout).expect("one JSON value")
}

/// Holds the `metrics` of a result to its bounds, all at once: a change that trades one for another shows both.
fn hold(name: &str, metrics: &Value, bounds: &Bounds) {
    let number = |pointer: &str| metrics.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    let outside = number("/n_outside_mask") / number("/whole/n_region");
    let checks = [
        ("body median, mm", number("/body/depth_mm/median"), bounds.body_median_mm),
        ("whole MAE, mm", number("/whole/depth_mm/mae"), bounds.whole_mae_mm),
        ("share without depth", 1.0 - number("/whole/coverage"), 1.0 - bounds.coverage),
        ("share off by more than 1 mm", 1.0 - number("/whole/under_1mm"), bounds.outliers),
        ("share beside the surface", outside, bounds.outside),
    ];
    let line = |(what, found, bound): &(&str, f64, f64)| {
        let sign = if found <= bound { "<=" } else { "ABOVE" };
        format!("{name}: {what} {found:.4} {sign} {bound:.4}\n")
    };
    let table: String = checks.iter().map(line).collect();
    print!("{table}");
    assert!(checks.iter().all(|(_, found, bound)| found <= bound), "\n{table}");
}

/// What the README shows first.
#[test]
fn the_demo_is_as_accurate_as_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let answer = ok(&["demo", "-o", dir.path().join("demo").to_str().unwrap()]);
    let results = answer["results"].as_array().unwrap();
    assert_eq!(results.len(), 1);
    let folder = Path::new(results[0]["result"].as_str().unwrap());
    for file in ["report.html", "mesh.ply", "points.ply", "preview.png", "depth.npy", "sigma.npy", "result.json"] {
        assert!(folder.join(file).metadata().is_ok_and(|m| m.len() > 0), "the demo left no {file}");
    }
    let bounds =
        Bounds { body_median_mm: 0.067, whole_mae_mm: 0.113, coverage: 0.958, outliers: 0.008, outside: 0.001 };
    hold("demo", &results[0]["summary"]["metrics"], &bounds);
}

/// A color camera and film, one color pattern, no black images.
#[test]
fn a_color_rig_is_as_accurate_as_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig");
    let at = |path: &str| rig.join(path).to_str().unwrap().to_owned();
    ok(&["simulate", "color", "-o", &at("")]);
    ok(&["calibrate", &at("")]);
    for (scene, bounds) in [
        ("vase", Bounds { body_median_mm: 0.18, whole_mae_mm: 0.32, coverage: 0.958, outliers: 0.047, outside: 0.001 }),
        ("ball", Bounds { body_median_mm: 0.19, whole_mae_mm: 0.3, coverage: 0.965, outliers: 0.05, outside: 0.001 }),
    ] {
        let truth = at(&format!("scenes/{scene}/truth"));
        let answer = ok(&["reconstruct", &at(""), scene, "--truth", &truth]);
        hold(&format!("color, {scene}"), &answer["summary"]["metrics"], &bounds);
    }
}
