//! The methods that train a signed distance field from scratch, on a small virtual rig without sensor noise: recipe
//! `paper` and TurboSL. Few iterations, so these tests say that everything is wired up and converges, not how good it
//! gets.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use nelu3d_scan::pattern::{Axis, Pattern, Random, Sinusoid};
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{LightSpec, PatternSetSpec, ShapeSpec, SweepSpec};
use serde_json::Value;

use super::common::{calibrated, nelu3d, stderr};

/// The rig with a calibrated field, made once.
fn rig() -> &'static Path {
    static RIG: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &RIG.get_or_init(|| calibrated(&spec())).1
}

/// A camera almost without noise, a ball and a bead, eight board positions, three patterns.
fn spec() -> Spec {
    let mut spec = Spec::preset("shapes").expect("a preset");
    // In the end every pixel is rendered, which takes longer than many of these trainings.
    let c = &mut spec.camera;
    (c.width, c.height) = (c.width * 3 / 4, c.height * 3 / 4);
    (c.fx, c.fy, c.cx, c.cy) = (0.75 * c.fx, 0.75 * c.fy, 0.75 * (c.cx + 0.5) - 0.5, 0.75 * (c.cy + 0.5) - 0.5);
    spec.scenes.retain(|s| s.name == "sphere");
    // A first iteration needs no more than a few pixels, and all are rendered after it.
    let mut bead = spec.scenes[0].clone();
    bead.name = "bead".into();
    let ShapeSpec::Sphere { radius_mm } = &mut bead.objects[0].shape else { panic!("the preset has a ball") };
    *radius_mm *= 0.25;
    spec.scenes.push(bead);
    (spec.camera.full_well_electrons, spec.camera.read_noise_electrons) = (1e9, 0.01);
    spec.camera.electrons_per_sec = (0.8e9 / spec.camera.exposure_secs).into();
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("the preset's board is on a stage") };
    *positions = 8;
    let LightSpec::Projector(p) = &mut spec.light else { panic!("the preset has a projector") };
    (p.sharp_sigma_px, p.aperture_mm, p.gamma) = (0.5, 4.0, 1.0.into());
    let random = |seed| Pattern::Random(Random { axis: Axis::X, min_period_px: 60.0, max_period_px: 400.0, seed });
    let sine = Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px: 160.0, steps: 2 });
    let patterns = vec![sine, random(1), random(2)];
    spec.pattern_sets = vec![PatternSetSpec { name: "smooth".into(), patterns }];
    spec
}

/// Runs a method on a scene and returns the summary.
fn reconstruct(scene: &str, args: &[&str]) -> Value {
    let (rig, dir) = (rig(), tempfile::tempdir().unwrap());
    let (result, truth) = (dir.path().join("result"), rig.join("scenes").join(scene).join("truth"));
    let mut all = vec![args[0], rig.to_str().unwrap(), scene];
    all.extend(["--truth", truth.to_str().unwrap(), "-o", result.to_str().unwrap(), "--quiet"]);
    all.extend(&args[1..]);
    let out = nelu3d(&all);
    assert!(out.status.success(), "{args:?}: {}", stderr(&out));
    let text = std::fs::read_to_string(result.join("result.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// (coverage, median |error| in mm away from silhouettes)
fn body(summary: &Value) -> (f64, f64) {
    let body = &summary["metrics"]["body"];
    (body["coverage"].as_f64().unwrap(), body["depth_mm"]["median"].as_f64().unwrap())
}

/// Seeds 0, 1, and 2 come to a median of 0.23, 0.28, and 0.22 mm.
#[test]
fn recipe_paper_finds_the_ball() {
    let steps = ["--recipe", "paper", "--steps", "200", "--samples", "8192"];
    let summary = reconstruct("sphere", &[&["reconstruct"], &steps[..]].concat());
    let (coverage, median) = body(&summary);
    // The background is carved and the occupancy grid emptied, so that rays grow.
    let last = summary["method"]["losses"].as_array().unwrap().last().unwrap();
    assert!(last["occupied"].as_f64().unwrap() < 0.3 && last["rays"].as_u64().unwrap() > 400, "{last}");
    assert!(coverage > 0.95 && median < 0.9, "{coverage} {median}");
    let losses = summary["method"]["losses"].as_array().unwrap();
    let image = |i: usize| losses[i]["image"].as_f64().unwrap();
    assert!(image(losses.len() - 1) < 0.5 * image(0), "{losses:?}");
}

/// TurboSL learns albedo and ambient light too, so it is slower: that it is on its way from the sphere it starts with.
/// Seeds 0, 1, and 2 come to a median of 1.8, 5.3, and 3.1 mm.
#[test]
fn turbosl_moves_to_the_ball() {
    let summary = reconstruct("sphere", &["decode", "--method", "turbosl", "--steps", "200", "--samples", "8192"]);
    let (coverage, median) = body(&summary);
    assert!(coverage > 0.85 && median < 6.0, "{coverage}: {median}");
    let losses = summary["method"]["losses"].as_array().unwrap();
    let image = |i: usize| losses[i]["image"].as_f64().unwrap();
    assert!(image(losses.len() - 1) < 0.1 * image(0), "{losses:?}");
}

/// The paper's own color field, as coarse as eight boards can teach: it predicts held-out samples, and the surface is
/// trained on it without a spline in between.
#[test]
fn recipe_paper_finds_the_ball_with_the_published_color_field() {
    let dir = tempfile::tempdir().unwrap();
    let (field, result) = (dir.path().join("field.safetensors"), dir.path().join("result"));
    let (rig, truth) = (rig().to_str().unwrap(), rig().join("scenes/sphere/truth"));
    let small = ["--form", "published", "--levels", "6", "--base-cells", "4", "--finest-cells", "24"];
    let short = ["--iterations", "400", "--batch", "2048", "--accept", "--json", "--quiet"];
    let args = ["calibrate", rig, "-o", field.to_str().unwrap()];
    let out = nelu3d(&[&args[..], &small[..], &short[..]].concat());
    assert!(out.status.success(), "{}", stderr(&out));
    let answer: Value = serde_json::from_slice(&out.stdout).unwrap();
    let quality = &answer["report"]["quality"];
    assert!(quality["pixels"]["psnr_db"].as_f64().unwrap() > 30.0, "{quality}");
    let (out, shown) = (result.to_str().unwrap(), truth.to_str().unwrap());
    let args = ["reconstruct", rig, "sphere", "--field", field.to_str().unwrap(), "--truth", shown, "-o", out];
    let steps = ["--quiet", "--recipe", "paper", "--steps", "100", "--samples", "8192"];
    let out = nelu3d(&[&args[..], &steps[..]].concat());
    assert!(out.status.success(), "{}", stderr(&out));
    let summary: Value = serde_json::from_str(&std::fs::read_to_string(result.join("result.json")).unwrap()).unwrap();
    let (coverage, median) = body(&summary);
    // 36 dB at samples, but 16 dB at a board that was held out: the surface is found to 1.6 mm, and with a field that
    // says nothing of depth not at all.
    assert!(coverage > 0.9 && median < 4.0, "{coverage} {median}");
    let losses = summary["method"]["losses"].as_array().unwrap();
    let image = |i: usize| losses[i]["image"].as_f64().unwrap();
    assert!(image(losses.len() - 1) < image(0), "{losses:?}");
    let out = nelu3d(&["calibrate", rig, "--form", "published", "--base-cells", "64", "--finest-cells", "32"]);
    assert!(!out.status.success() && stderr(&out).contains("finest_resolution (32)"), "{}", stderr(&out));
}

#[test]
fn ablations_change_what_is_minimized() {
    // The first iteration sees the same rays of the same surface, so only the setting makes the difference.
    let first = |settings: &[&str]| {
        let steps = ["reconstruct", "--recipe", "paper", "--start", "random", "--steps", "1", "--samples", "8192"];
        reconstruct("bead", &[&steps[..], settings].concat())["method"]["losses"][0]["image"].as_f64().unwrap()
    };
    let lookup = first(&["--lookup-loss-weight", "1"]);
    let pattern = first(&["--lookup-loss-weight", "0"]);
    let (blend, without) = (first(&[]), first(&["--ambient", "none"]));
    // Eq. 4, with the published weight of 0.1.
    assert!((blend - (0.9 * pattern + 0.1 * lookup)).abs() < 1e-6 * blend, "{blend} of {lookup} and {pattern}");
    assert!((without - blend).abs() > 0.01 * blend, "{without} {blend}");
    let unbounded = first(&["--ambient", "unbounded"]);
    assert!((unbounded - blend).abs() > 0.01 * blend, "{unbounded} {blend}");
    first(&["--background", "carve"]);
    let out = nelu3d(&["reconstruct", "rig", "scene", "--recipe", "paper", "--lookup-loss-weight", "1.5"]);
    assert_eq!(out.status.code(), Some(2));
}
