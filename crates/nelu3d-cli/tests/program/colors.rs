//! Cross-talk of a color camera, from a scene of saturated colors to a surface without its marks.

use std::path::Path;

use nelu3d_sim::Spec;
use serde_json::Value;

use super::common::{nelu3d, simulated, small, stderr};

/// What each channel sees of the light's colors.
const MIXING: [[f64; 3]; 3] = [[0.85, 0.15, 0.0], [0.15, 0.7, 0.15], [0.0, 0.15, 0.85]];

/// Three saturated balls under color film.
fn spec() -> Spec {
    let mut spec = small("film-triton");
    spec.sequences.clear();
    spec.camera.color_mixing = MIXING;
    let ball = |x: f64, rgb: [f64; 3]| {
        format!(
            "[[objects]]\nposition_mm = [{x:?}, 0.0, 705.0]\nshape = {{ kind = \"sphere\", radius_mm = 27.0 }}\nalbedo = {{ \
             kind = \"constant\", rgb = {rgb:?} }}\n"
        )
    };
    let balls = [ball(-56.0, [0.8, 0.1, 0.08]), ball(0.0, [0.1, 0.7, 0.12]), ball(56.0, [0.08, 0.12, 0.75])].concat();
    spec.scenes.push(toml::from_str(&format!("name = \"balls\"\nblack = false\n{balls}")).expect("a scene"));
    spec
}

fn ok(args: &[&str]) -> Value {
    let out = nelu3d(&[args, &["--quiet", "--json"]].concat());
    assert!(out.status.success(), "{args:?}: {}", stderr(&out));
    serde_json::from_slice(&out.stdout).expect("one JSON value")
}

#[test]
fn cross_talk_is_found_and_taken_out() {
    let (dir, rig) = simulated(&spec());
    let rig = rig.to_str().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let field = path("plain.safetensors");
    assert!(ok(&["calibrate", rig, "-o", &field])["mixing"].is_null());
    let truth = Path::new(rig).join("scenes/balls/truth");
    let out = path("result");
    let reconstruct = |field: &str, cross_talk: &str| {
        let args = ["--field", field, "--cross-talk", cross_talk, "--truth", truth.to_str().unwrap()];
        nelu3d(&[&["reconstruct", rig, "balls", "-o", &out, "--quiet", "--json"][..], &args].concat())
    };
    let median = |out: &std::process::Output| -> f64 {
        assert!(out.status.success(), "{}", stderr(out));
        let answer: Value = serde_json::from_slice(&out.stdout).expect("one JSON value");
        answer["summary"]["metrics"]["body"]["depth_mm"]["median"].as_f64().unwrap()
    };
    let (with, without) = (median(&reconstruct(&field, "auto")), reconstruct(&field, "off"));
    // Without the model the saturated balls are off by more than a millimeter, or refused.
    let refused = stderr(&without).contains("without a consistent code");
    assert!(with < 0.5 && (refused || with < 0.5 * median(&without)), "{with} with the model");

    // Kept with the field, and close to the truth.
    let kept = path("kept.safetensors");
    let found = &ok(&["calibrate", rig, "--colors", "balls", "-o", &kept])["mixing"];
    for (i, row) in MIXING.iter().enumerate() {
        for (j, truth) in row.iter().enumerate() {
            let value = found[i][j].as_f64().unwrap();
            assert!((value - truth).abs() < 0.06, "{i},{j}: {value} of {truth}");
        }
    }
    let again = median(&reconstruct(&kept, "auto"));
    assert!((again - with).abs() < 0.1 * with, "{again} {with}");
}

#[test]
fn one_channel_has_no_cross_talk() {
    let mut spec = Spec::preset("demo").expect("a preset");
    let nelu3d_sim::spec::SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("a stage") };
    *positions = 3;
    let (_dir, rig) = simulated(&spec);
    let out = nelu3d(&["calibrate", rig.to_str().unwrap(), "--colors", "vase"]);
    assert!(!out.status.success());
    assert!(stderr(&out).contains("--colors is for color cameras"), "{}", stderr(&out));
}

/// A color camera before a projector: one image of three patterns, and two gray ones that it takes in its mono mode.
fn mixed() -> Spec {
    let mut spec = small("dlp");
    spec.camera.channels = "rgb".into();
    spec.camera.electrons_per_sec = nelu3d_sim::spec::PerColor::Each([600_000.0, 700_000.0, 500_000.0]);
    spec.camera.mono_images = vec!["random_00.png".into(), "random_01.png".into()];
    let random =
        |seed: u32| format!("{{ family = \"random\", min_period_px = 40, max_period_px = 640, seed = {seed} }}");
    let rgb = format!("{{ family = \"rgb\", parts = [{}, {}, {}] }}", random(3), random(4), random(5));
    let set = format!("name = \"mixed\"\npatterns = [{rgb}, {}, {}]", random(1), random(2));
    spec.pattern_sets = vec![toml::from_str(&set).expect("a pattern set")];
    let ball = "[[objects]]\nposition_mm = [0.0, 0.0, 705.0]\nshape = { kind = \"sphere\", radius_mm = 40.0 }\nalbedo = { kind = \
                \"constant\", rgb = [0.8, 0.2, 0.1] }\n";
    spec.scenes.push(toml::from_str(&format!("name = \"ball\"\n{ball}")).expect("a scene"));
    spec
}

/// Mono images among those of a color camera: used where they always were mono, refused where they were not.
#[test]
fn sets_may_mix_mono_and_color_images() {
    let (dir, rig) = simulated(&mixed());
    let at = |name: &str| rig.join(name).to_str().unwrap().to_owned();
    let root = rig.to_str().unwrap();
    let channels = |name: &str| nelu3d_scan::image::decode(&rig.join(name), None).unwrap().channels;
    assert_eq!(["white.png", "rgb_00.png", "random_01.png"].map(|n| channels(&format!("scenes/ball/{n}"))), [3, 3, 1]);
    ok(&["check", root]);
    ok(&["calibrate", root]);
    let out = dir.path().join("result");
    let truth = at("scenes/ball/truth");
    let answer = ok(&["reconstruct", root, "ball", "-o", out.to_str().unwrap(), "--truth", &truth]);
    let depth = &answer["summary"]["metrics"]["body"]["depth_mm"];
    assert!(depth["median"].as_f64().unwrap() < 0.2, "{depth}");

    // The red ball's white is red, and yet a gray pattern returns its share in every channel.
    let read = nelu3d_scan::Rig::open(&rig).unwrap();
    let capture =
        read.read_shot(&read.scene("ball").unwrap(), &read.pattern_sets[0], nelu3d_scan::rig::Need::Scene).unwrap();
    assert_eq!(capture.mono, [false, true, true]);

    let refused = |args: &[&str], file: &str| {
        let out = nelu3d(args);
        let said = stderr(&out) + &String::from_utf8_lossy(&out.stdout);
        assert!(!out.status.success() && said.contains(file), "{args:?}: {said}");
        assert!(said.contains("the same way"), "{args:?}: {said}");
    };
    // A scene that was taken in another mode than the sweep.
    std::fs::copy(at("scenes/ball/random_01.png"), at("scenes/ball/rgb_00.png")).unwrap();
    refused(&["reconstruct", root, "ball", "-o", out.to_str().unwrap()], "ball/rgb_00.png");
    refused(&["check", root], "ball/rgb_00.png");
    // A sweep of two modes.
    std::fs::copy(at("calibration/003/rgb_00.png"), at("calibration/003/random_00.png")).unwrap();
    refused(&["calibrate", root], "random_00.png");
    // The flash must have all channels.
    std::fs::copy(at("scenes/ball/random_01.png"), at("scenes/ball/white.png")).unwrap();
    let said = stderr(&nelu3d(&["reconstruct", root, "ball"]));
    assert!(said.contains("ball/white.png") && said.contains("one channel"), "{said}");
}
