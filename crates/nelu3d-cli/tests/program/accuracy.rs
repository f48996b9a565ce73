//! The accuracy of the main path, from a virtual rig to a surface, with the default settings: what nobody may lose
//! unseen.
//!
//! Bounds lie a fifth above what was measured when they were set; whoever makes the method better lowers them.

use std::path::Path;

use nelu3d_sim::Spec;
use nelu3d_sim::spec::{
    BoardCurlSpec, BoardSpec, DepthSpacing, HandsSpec, ObjectSpec, SceneSpec, ShapeSpec, SweepSpec,
};
use serde_json::Value;

use super::common::{nelu3d, simulated, stderr};

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
        Bounds { body_median_mm: 0.052, whole_mae_mm: 0.091, coverage: 0.958, outliers: 0.0015, outside: 0.001 };
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

/// A preset with an image of `scale` times its width, `positions` boards, and one scene.
fn reduced(preset: &str, scale: f64, positions: usize, scene: &str) -> Spec {
    let mut spec = Spec::preset(preset).expect("a preset");
    let c = &mut spec.camera;
    // The center of the first pixel is at 0.
    (c.cx, c.cy) = ((c.cx + 0.5) * scale - 0.5, (c.cy + 0.5) * scale - 0.5);
    (c.fx, c.fy) = (c.fx * scale, c.fy * scale);
    (c.width, c.height) = ((c.width as f64 * scale) as usize, (c.height as f64 * scale) as usize);
    if let SweepSpec::Stage { positions: n, .. } = &mut spec.sweep {
        *n = positions;
    }
    spec.scenes.retain(|s| s.name == scene);
    spec.sequences.clear();
    assert_eq!(spec.scenes.len(), 1, "{preset} has {scene}");
    spec
}

/// Calibrates and scans the rig of a spec with one scene, and holds the result to `bounds`.
fn scan(name: &str, spec: &Spec, bounds: &Bounds) {
    let (_folder, rig) = simulated(spec);
    let (rig, scene) = (rig.to_str().unwrap(), spec.scenes[0].name.as_str());
    ok(&["calibrate", rig]);
    let answer = ok(&["reconstruct", rig, scene, "--truth", &format!("{rig}/scenes/{scene}/truth")]);
    hold(name, &answer["summary"]["metrics"], bounds);
}

/// A sharp projector. Its markers stand in nearly the same pixels at every position of the stage, so that whatever
/// misreads their corners is the same for all.
#[test]
fn a_sharp_projector_is_as_accurate_as_it_was() {
    let bounds =
        Bounds { body_median_mm: 0.056, whole_mae_mm: 0.119, coverage: 0.952, outliers: 0.007, outside: 0.001 };
    scan("dlp", &reduced("dlp", 0.4, 12, "vase"), &bounds);
}

/// A cheap projector: blurred, tilted focus, stray light, a curved response.
#[test]
fn a_cheap_projector_is_as_accurate_as_it_was() {
    let bounds = Bounds { body_median_mm: 0.108, whole_mae_mm: 0.195, coverage: 0.949, outliers: 0.02, outside: 0.001 };
    scan("lcd", &reduced("lcd", 0.4, 12, "vase"), &bounds);
}

/// Depth jumps and shadows.
#[test]
fn occlusions_are_as_accurate_as_they_were() {
    let bounds =
        Bounds { body_median_mm: 0.079, whole_mae_mm: 0.137, coverage: 0.966, outliers: 0.011, outside: 0.001 };
    scan("shapes", &reduced("shapes", 0.75, 12, "occlusion"), &bounds);
}

/// Four boards before a ball and a wall.
fn four_boards(hands: Option<HandsSpec>, write_poses: bool) -> Spec {
    let mut spec = reduced("shapes", 0.75, 12, "sphere");
    spec.sweep = SweepSpec::Handheld {
        positions: 4,
        first_mm: 600.0,
        last_mm: 800.0,
        center_mm: [0.0, 0.0],
        position_sigma_mm: 12.0,
        tilt_sigma: 0.3,
        depths: DepthSpacing::Scattered,
        max_tilt: Some(0.698),
        min_in_view: 0.67,
        hands,
        write_poses,
    };
    let wall = ShapeSpec::Plane { width_mm: 180.0, height_mm: 140.0 };
    let wall = ObjectSpec { rotation: [0.02, -0.1, 0.0], ..ObjectSpec::new(wall, [0.0, 0.0, 750.0]) };
    let ball = ObjectSpec::new(ShapeSpec::Sphere { radius_mm: 50.0 }, [0.0, 0.0, 700.0]);
    spec.scenes = vec![SceneSpec::new("seen", vec![ball, wall])];
    spec
}

/// Four boards, held by a hand that covers a part of each: the light's center has to be found, and to hold between
/// them.
#[test]
fn four_boards_held_by_hand_are_as_accurate_as_they_were() {
    let hands = Some(HandsSpec { number: 1, size_mm: 40.0, albedo: [0.5, 0.35, 0.3] });
    let bounds = Bounds { body_median_mm: 0.12, whole_mae_mm: 0.285, coverage: 0.962, outliers: 0.015, outside: 0.001 };
    scan("by hand", &four_boards(hands, false), &bounds);
}

/// Three boards leave gaps on the light's rays, and a period of the code that is explained somewhere else. What lies in
/// a gap or behind all boards has no depth, rather than a wrong period's.
#[test]
fn phases_of_three_boards_keep_no_wrong_period() {
    let mut spec = four_boards(Some(HandsSpec { number: 1, size_mm: 40.0, albedo: [0.5, 0.35, 0.3] }), false);
    let SweepSpec::Handheld { positions, .. } = &mut spec.sweep else { unreachable!("boards by hand") };
    (*positions, spec.seed, spec.supersampling, spec.board_albedo) = (3, 3, 2, [0.05, 0.85]);
    let wall = ShapeSpec::Plane { width_mm: 400.0, height_mm: 300.0 };
    let wall = ObjectSpec { rotation: [0.05, -0.1, 0.0], ..ObjectSpec::new(wall, [0.0, 0.0, 1000.0]) };
    let ball = ObjectSpec::new(ShapeSpec::Sphere { radius_mm: 50.0 }, [0.0, 0.0, 700.0]);
    spec.scenes.extend([SceneSpec::new("before", vec![ball, wall.clone()]), SceneSpec::new("behind", vec![wall])]);
    let mut table = toml::Table::try_from(&spec).unwrap();
    // The light is dim toward its corners.
    table["light"]["vignetting"] = 40.0.into();
    table["pattern_sets"] = toml::toml! {
        all = [{ name = "phases", patterns = [
            { family = "phase", axis = "x", periods_px = [20.0, 640.0], steps = [3, 3] },
        ] }]
    }["all"]
        .clone();
    let (_folder, rig) = simulated(&table.try_into().unwrap());
    let rig = rig.to_str().unwrap();
    ok(&["calibrate", rig]);
    let answer = ok(&["reconstruct", rig, "seen", "--truth", &format!("{rig}/scenes/seen/truth")]);
    let bounds =
        Bounds { body_median_mm: 0.113, whole_mae_mm: 0.175, coverage: 0.963, outliers: 0.0108, outside: 0.001 };
    hold("three boards", &answer["summary"]["metrics"], &bounds);
    // A wall that is out of reach is no reason to doubt what stands before it.
    assert_eq!(ok(&["reconstruct", rig, "before"])["verdict"], "good");
    let behind = nelu3d(&["reconstruct", rig, "behind", "--quiet"]);
    let why = stderr(&behind);
    assert!(!behind.status.success() && why.contains("put the object where the board was swept"), "{why}");
}

/// A wall behind all boards has a depth where the light's rays that meet it are known, and none elsewhere: neither
/// where they are known, but not so far away, nor where no board has met them.
#[test]
fn a_wall_behind_the_boards_is_not_on_a_wrong_period() {
    let spec: Spec = toml::from_str(include_str!("chessboards.toml")).unwrap();
    let (_folder, rig) = simulated(&spec);
    let rig = rig.to_str().unwrap();
    ok(&["calibrate", rig]);
    let answer = ok(&["reconstruct", rig, "object", "--truth", &format!("{rig}/scenes/object/truth")]);
    let bounds =
        Bounds { body_median_mm: 0.144, whole_mae_mm: 0.352, coverage: 0.285, outliers: 0.0165, outside: 0.001 };
    hold("chessboards", &answer["summary"]["metrics"], &bounds);
}

/// A code that repeats explains a wall far behind the boards at depths where these were. It has no depth where the
/// light's rays, continued, show that it is behind: with or without an object before it.
#[test]
fn a_wall_behind_the_boards_is_behind_them() {
    let spec: Spec = toml::from_str(include_str!("wall.toml")).unwrap();
    let (_folder, rig) = simulated(&spec);
    let rig = rig.to_str().unwrap();
    ok(&["calibrate", rig]);
    let answer = ok(&["reconstruct", rig, "before", "--truth", &format!("{rig}/scenes/before/truth")]);
    let bounds = Bounds { body_median_mm: 0.35, whole_mae_mm: 0.6, coverage: 0.065, outliers: 0.13, outside: 0.001 };
    hold("before a wall", &answer["summary"]["metrics"], &bounds);
    let alone = nelu3d(&["reconstruct", rig, "alone", "--quiet"]);
    let why = stderr(&alone);
    assert!(!alone.status.success() && why.contains("put the object where the board was swept"), "{why}");
}

/// Boards whose poses are off by a millimeter and a quarter of a degree, one this way and the next that way, are moved
/// to where the codewords of the others say that they are.
#[test]
fn wrong_poses_are_refined_on_codewords() {
    let (_folder, rig) = simulated(&four_boards(None, true));
    let (file, rig) = (rig.join("rig.toml"), rig.to_str().unwrap());
    let mut text: toml::Table = std::fs::read_to_string(&file).unwrap().parse().unwrap();
    for (i, pose) in text["poses"].as_array_mut().unwrap().iter_mut().enumerate() {
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        for (key, axis, by) in [("rotation", 0, 0.004), ("translation", 2, 1.0)] {
            let value = &mut pose[key][axis];
            *value = toml::Value::Float(value.as_float().unwrap() + sign * by);
        }
    }
    std::fs::write(&file, text.to_string()).unwrap();
    let answer = ok(&["calibrate", rig, "-o", &format!("{rig}/refined")]);
    let number = |pointer: &str| answer.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    let (before, after) = (number("/report/refined_poses/psnr_before_db"), number("/report/quality/psnr_db"));
    let moved = number("/report/refined_poses/rms_mm");
    println!("wrong poses: {before:.2} -> {after:.2} dB, moved by {moved:.2} mm");
    assert!(after > before + 1.0, "{before} {after}");
    assert!((0.5..1.5).contains(&moved), "{moved}");
}

/// Four chessboards whose corner curls by 4 mm. What a wall shows where the curl was is right all the same.
#[test]
fn a_curled_corner_of_the_board_is_taken_into_account() {
    let mut spec = four_boards(None, false);
    let wall = ShapeSpec::Plane { width_mm: 200.0, height_mm: 150.0 };
    let wall = ObjectSpec { rotation: [0.02, -0.1, 0.0], ..ObjectSpec::new(wall, [0.0, 0.0, 720.0]) };
    spec.scenes = vec![SceneSpec::new("wall", vec![wall])];
    spec.board_curl = Some(BoardCurlSpec { height_mm: 4.0, length_mm: 70.0 });
    spec.board_albedo = [0.05, 0.85];
    spec.board =
        BoardSpec::Chessboard { columns: 10, rows: 8, square_mm: 20.0, extent_mm: Some([-5.0, -5.0, 205.0, 165.0]) };
    let (_folder, rig) = simulated(&spec);
    let rig = rig.to_str().unwrap();
    let answer = ok(&["calibrate", rig]);
    let relief = &answer["report"]["refined_poses"]["relief"];
    let answer = ok(&["reconstruct", rig, "wall", "--truth", &format!("{rig}/scenes/wall/truth")]);
    let bounds = Bounds { body_median_mm: 0.05, whole_mae_mm: 0.122, coverage: 0.99, outliers: 0.02, outside: 0.001 };
    hold("curled board", &answer["summary"]["metrics"], &bounds);
    let largest = relief["largest_mm"].as_f64().expect("the relief of the board is reported");
    assert!((0.5..2.0).contains(&largest), "{largest}");
}

// ---- Rigs that code of ours did not write; see CONTRIBUTING.md ----

/// Returns a shared rig, if this machine has them.
fn shared_rig(name: &str) -> Option<String> {
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name);
    if !rig.is_dir() {
        eprintln!("SKIPPED: {} is not there: its scans are not compared with their ground truth", rig.display());
        return None;
    }
    Some(rig.to_str().unwrap().to_owned())
}

/// Calibrates a shared rig and scans one of its scenes, both with these arguments added; returns the answer of the scan.
fn scan_of_shared(rig: &str, scene: &str, calibrate: &[&str], reconstruct: &[&str]) -> Value {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    ok(&[&["calibrate", rig, "-o", &path("field")], calibrate].concat());
    ok(&[&["reconstruct", rig, scene, "--field", &path("field"), "-o", &path("result")], reconstruct].concat())
}

#[test]
fn shared_dlp_is_as_accurate_as_it_was() {
    let Some(rig) = shared_rig("dlp") else { return };
    let scan = scan_of_shared(&rig, "pawn", &[], &["--truth", &format!("{rig}/scenes/pawn/truth")]);
    let bounds = Bounds { body_median_mm: 0.113, whole_mae_mm: 0.26, coverage: 0.98, outliers: 0.034, outside: 0.006 };
    hold("shared dlp, pawn", &scan["summary"]["metrics"], &bounds);
}

#[test]
fn shared_film_is_as_accurate_as_it_was() {
    let Some(rig) = shared_rig("film") else { return };
    let scan = scan_of_shared(&rig, "spot", &[], &["--truth", &format!("{rig}/scenes/spot/truth")]);
    let bounds = Bounds { body_median_mm: 0.49, whole_mae_mm: 0.98, coverage: 0.96, outliers: 0.28, outside: 0.003 };
    hold("shared film, spot", &scan["summary"]["metrics"], &bounds);
}

/// A real scan without a ground truth: three patterns that leave no color unused, so that every codeword has some depth
/// on every ray, and a piece may not be refused for that.
#[test]
fn shared_david_is_scanned() {
    let Some(rig) = shared_rig("david") else { return };
    let scan = scan_of_shared(&rig, "david", &["--from-projector"], &["--effort", "quick"]);
    let kept = scan["summary"]["pixels"]["kept"].as_u64().unwrap();
    let median = scan["summary"]["depth_mm"]["median"].as_f64().unwrap();
    assert_eq!(scan["verdict"], "good");
    assert!(kept > 240_000 && (630.0..640.0).contains(&median), "{kept} pixels at {median} mm");
}
