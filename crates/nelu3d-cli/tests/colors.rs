//! Cross-talk of a color camera, from a scene of saturated colors to a surface without its marks.

mod common;

use std::path::Path;

use nelu3d_sim::Spec;
use serde_json::Value;

use common::{nelu3d, simulated, small, stderr};

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
    let median = |field: &str, cross_talk: &str| -> f64 {
        let args = ["--field", field, "--cross-talk", cross_talk, "--truth", truth.to_str().unwrap()];
        let out = path("result");
        let answer = ok(&[&["reconstruct", rig, "balls", "-o", &out][..], &args].concat());
        answer["summary"]["metrics"]["body"]["depth_mm"]["median"].as_f64().unwrap()
    };
    let (with, without) = (median(&field, "auto"), median(&field, "off"));
    assert!(with < 0.5 && with < 0.5 * without, "{with} with the model, {without} without");

    // Kept with the field, and close to the truth.
    let kept = path("kept.safetensors");
    let found = &ok(&["calibrate", rig, "--colors", "balls", "-o", &kept])["mixing"];
    for (i, row) in MIXING.iter().enumerate() {
        for (j, truth) in row.iter().enumerate() {
            let value = found[i][j].as_f64().unwrap();
            assert!((value - truth).abs() < 0.06, "{i},{j}: {value} of {truth}");
        }
    }
    let again = median(&kept, "auto");
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
