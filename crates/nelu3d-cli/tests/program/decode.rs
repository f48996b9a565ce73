//! `nelu3d decode` and `nelu3d projector` on a virtual rig with every kind of code and no sensor noise.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use nelu3d_scan::camera::read_projector;
use nelu3d_scan::pattern::{Axis, Gray, Pattern, Random, Sinusoid};
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{LightSpec, PatternSetSpec, SweepSpec};
use serde_json::Value;

use super::common::{nelu3d, simulated, stderr};

/// The rig, made once for all tests; removed when the process ends by the system's own cleaning of its temporary
/// folder.
fn rig() -> &'static Path {
    static RIG: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &RIG.get_or_init(|| simulated(&spec())).1
}

/// A 12-bit camera without noise, a projector with a gamma of 1, codes of all kinds, a ball, six board positions.
fn spec() -> Spec {
    let mut spec = Spec::preset("shapes").expect("a preset");
    spec.scenes.retain(|s| s.name == "sphere");
    spec.supersampling = 3;
    (spec.camera.full_well_electrons, spec.camera.read_noise_electrons) = (1e9, 0.01);
    spec.camera.electrons_per_sec = (0.8e9 / spec.camera.exposure_secs).into();
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("the preset's board is on a stage") };
    *positions = 5;
    let LightSpec::Projector(p) = &mut spec.light else { panic!("the preset has a projector") };
    (p.sharp_sigma_px, p.aperture_mm) = (0.5, 4.0);
    let sine = |period_px: f64, steps| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps });
    let random = |seed| Pattern::Random(Random { axis: Axis::X, min_period_px: 30.0, max_period_px: 300.0, seed });
    let gray = |axis, inverse| Pattern::Gray(Gray { axis, inverse });
    let sets: [(&str, Vec<Pattern>); 6] = [
        ("gray", vec![gray(Axis::X, true), gray(Axis::Y, true)]),
        ("gray-x", vec![gray(Axis::X, false)]),
        ("phase", vec![sine(20.0, 4), sine(90.0, 3), sine(640.0, 3)]),
        ("one", vec![sine(60.0, 3)]),
        ("mps", vec![sine(16.0, 3), sine(16.9, 1), sine(18.1, 1), sine(19.3, 1), sine(20.9, 1)]),
        ("random", (0..6).map(random).collect()),
    ];
    spec.pattern_sets =
        sets.into_iter().map(|(name, patterns)| PatternSetSpec { name: name.into(), patterns }).collect();
    spec
}

/// Decodes the ball into a folder and returns the summary.
fn decode(set: &str, method: &str, more: &[&str]) -> Value {
    let out = tempfile::tempdir().expect("a temporary folder");
    let (rig, result) = (rig().to_str().unwrap(), out.path().join("result"));
    let truth = format!("{rig}/scenes/sphere/truth");
    let mut args = vec!["decode", rig, "sphere", "--set", set, "--method", method, "--truth", &truth, "-q", "--json"];
    args.extend(["-o", result.to_str().unwrap()]);
    args.extend(more);
    let done = nelu3d(&args);
    assert!(done.status.success(), "{set} {method}: {}", stderr(&done));
    for file in ["depth.npy", "normals.npy", "sigma.npy", "mesh.ply", "report.html", "result.json"] {
        assert!(result.join(file).exists(), "{method}: {file}");
    }
    serde_json::from_slice::<Value>(&done.stdout).unwrap()["summary"].take()
}

/// One projector column is 2.1 mm of depth here. Twelve bits are 0.0003 of full scale; what is left is the projector's
/// eight bits (0.001 of a sinusoid, 0.01 px of a period of 20), and for Gray code how straight an edge is between two
/// pixels. Pixels of the ball's body only: at its rim a pixel sees a piece of surface that is far from flat.
#[test]
fn every_method_meets_its_noise_floor() {
    let limits_mm = [
        ("gray", "gray", 0.12),
        ("gray-x", "gray", 0.12),
        ("phase", "phase", 0.04),
        ("mps", "mps", 0.04),
        ("random", "zncc", 0.04),
    ];
    for (set, method, limit) in limits_mm {
        let s = decode(set, method, &["--depth", "560", "840"]);
        let body = &s["metrics"]["body"];
        let (median, coverage) = (body["depth_mm"]["median"].as_f64().unwrap(), body["coverage"].as_f64().unwrap());
        let p95 = body["depth_mm"]["p95"].as_f64().unwrap();
        println!("{set} {method}: median {median:.4} mm, p95 {p95:.4} mm, coverage {coverage:.4}");
        assert!(median < limit, "{set} {method}: median {median} mm");
        assert!(p95 < 3.5 * limit, "{set} {method}: p95 {p95} mm");
        assert!(coverage > 0.97, "{set} {method}: {coverage}");
        // What the result says of itself.
        let sigma = s["depth_mm"]["median_sigma"].as_f64().unwrap();
        assert!((0.3 * median..6.0 * limit).contains(&sigma), "{set} {method}: sigma {sigma} for {median}");
        assert_eq!(s["method"]["settings"]["method"], method);
        assert!(s["stages"].as_array().unwrap().iter().any(|t| t["name"] == "triangulate"));
    }
}

/// One frequency is enough where the depth range spans less than a period, and refused where it does not.
#[test]
fn a_single_frequency_needs_a_narrow_range() {
    let s = decode("one", "phase", &["--depth", "640", "720"]);
    let body = &s["metrics"]["body"];
    assert!(body["depth_mm"]["median"].as_f64().unwrap() < 0.15 && body["coverage"].as_f64().unwrap() > 0.95, "{body}");
    let rig = rig().to_str().unwrap();
    let out = nelu3d(&["decode", rig, "sphere", "--set", "one", "--method", "phase"]);
    assert_eq!(out.status.code(), Some(1));
    let text = stderr(&out);
    assert!(text.contains("repeats every 60.0 px") && text.contains("--depth"), "{text}");
}

/// A window decodes where single pixels are ambiguous, and all columns may be searched.
#[test]
fn correlation_searches_as_told() {
    let all = decode("random", "zncc", &["--columns", "all"]);
    let windows = decode("random", "zncc", &["--patch", "5", "--depth", "560", "840"]);
    for s in [all, windows] {
        let body = &s["metrics"]["body"];
        assert!(
            body["depth_mm"]["median"].as_f64().unwrap() < 0.08 && body["coverage"].as_f64().unwrap() > 0.9,
            "{body}"
        );
    }
    let rig = rig().to_str().unwrap();
    let out = nelu3d(&["decode", rig, "sphere", "--set", "random", "--method", "zncc", "--patch", "4"]);
    assert!(out.status.code() == Some(1) && stderr(&out).contains("--patch"), "{}", stderr(&out));
}

#[test]
fn what_cannot_be_decoded_says_why() {
    let rig = rig().to_str().unwrap();
    for (set, method, why) in [
        ("phase", "gray", "values between black and white"),
        ("random", "phase", "is not a sinusoid"),
        ("phase", "mps", "have several shifts"),
        ("mps", "phase", "3 shifts are needed"),
        ("nothing", "gray", "no pattern set `nothing`"),
    ] {
        let out = nelu3d(&["decode", rig, "sphere", "--set", set, "--method", method]);
        assert_eq!(out.status.code(), Some(1), "{set} {method}");
        assert!(stderr(&out).contains(why), "{set} {method}: {}", stderr(&out));
    }
    // A rig whose projected images, or whose projector, are missing.
    let dir = tempfile::tempdir().unwrap();
    let bare = dir.path().join("bare");
    std::fs::create_dir(&bare).unwrap();
    for file in ["rig.toml", "camera.json", "projector.json"] {
        std::fs::copy(Path::new(rig).join(file), bare.join(file)).unwrap();
    }
    let scene = format!("{rig}/scenes/sphere");
    let run = || stderr(&nelu3d(&["decode", bare.to_str().unwrap(), &scene, "--set", "gray", "--method", "gray"]));
    let text = run();
    assert!(
        text.contains("gray_x_00.png") && text.contains("put the images that were projected into patterns/"),
        "{text}"
    );
    std::fs::remove_file(bare.join("projector.json")).unwrap();
    let text = run();
    assert!(text.contains("projector.json") && text.contains("nelu3d projector"), "{text}");
}

/// The sweep's Gray code gives the projector back.
#[test]
fn the_projector_is_calibrated_from_the_sweep() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("made.json");
    let rig = rig();
    let out = nelu3d(&["projector", rig.to_str().unwrap(), "-o", file.to_str().unwrap(), "-q", "--json"]);
    assert!(out.status.success(), "{}", stderr(&out));
    let report = serde_json::from_slice::<Value>(&out.stdout).unwrap()["report"].take();
    println!("{report}");
    let (made, truth) = (read_projector(&file).unwrap(), read_projector(&rig.join("projector.json")).unwrap());
    let off = (made.center() - truth.center()).norm();
    assert!(off < 1.0, "center off by {off} mm");
    assert!(report["rms_px"].as_f64().unwrap() < 0.1, "{report}");
    // Throughout the volume.
    let mut worst = 0.0f64;
    for (x, y, z) in grid(&[-70.0, 0.0, 70.0], &[-50.0, 0.0, 50.0], &[640.0, 700.0, 760.0]) {
        let p = nalgebra::Point3::new(x, y, z);
        let (a, b) = (made.project(&p).unwrap(), truth.project(&p).unwrap());
        worst = worst.max((a[0] - b[0]).abs()).max((a[1] - b[1]).abs());
    }
    println!("center off by {off:.3} mm, projected pixels by up to {worst:.4} px");
    assert!(worst < 0.1, "projected pixels off by up to {worst} px");
    // The virtual projector is linear.
    let gamma = report["response"]["gamma"].as_f64().expect("sinusoids were swept");
    assert!((gamma - 1.0).abs() < 0.03, "{gamma}");
    // Nothing is replaced unasked.
    let again = nelu3d(&["projector", rig.to_str().unwrap(), "-o", file.to_str().unwrap()]);
    assert!(again.status.code() == Some(1) && stderr(&again).contains("--force"), "{}", stderr(&again));
    // One axis is not enough.
    let other = dir.path().join("other.json");
    let one = nelu3d(&["projector", rig.to_str().unwrap(), "--set", "gray-x", "-o", other.to_str().unwrap()]);
    assert!(one.status.code() == Some(1) && stderr(&one).contains("one axis only"), "{}", stderr(&one));
}

fn grid(x: &[f64], y: &[f64], z: &[f64]) -> Vec<(f64, f64, f64)> {
    let pairs = x.iter().flat_map(|x| y.iter().map(move |y| (*x, *y)));
    pairs.flat_map(|(x, y)| z.iter().map(move |z| (x, y, *z))).collect()
}
