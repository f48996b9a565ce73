//! A flash beside the light that throws the patterns.

use std::path::Path;

use nelu3d_sim::Spec;
use nelu3d_sim::spec::LightSpec;
use serde_json::Value;

use super::common::{nelu3d, simulated, small, stderr};

/// A ball under color film, with the flash so many millimeters to the right of the film's lamp.
fn spec(offset_mm: f64) -> Spec {
    let mut spec = small("color");
    let LightSpec::Film(film) = &mut spec.light else { panic!("film") };
    film.flash_offset_mm = [offset_mm, 0.0, 0.0];
    let ball = "name = \"ball\"\nblack = false\n[[objects]]\nposition_mm = [0.0, 0.0, 700.0]\nshape = { kind = \"sphere\", \
                radius_mm = 52.0 }\nalbedo = { kind = \"constant\", rgb = [0.8, 0.75, 0.7] }\n";
    spec.scenes.push(toml::from_str(ball).expect("a scene"));
    spec
}

/// The offset that the ball's scan finds, mm, and the mean error of its body, mm.
fn scan(offset_mm: f64) -> ([f64; 3], f64) {
    let (dir, rig) = simulated(&spec(offset_mm));
    let truth = rig.join("scenes/ball/truth");
    let (rig, out) = (rig.to_str().unwrap(), dir.path().join("result"));
    let ok = |args: &[&str]| -> Value {
        let out = nelu3d(&[args, &["--quiet", "--json"]].concat());
        assert!(out.status.success(), "{args:?}: {}", stderr(&out));
        serde_json::from_slice(&out.stdout).expect("one JSON value")
    };
    ok(&["calibrate", rig]);
    let answer = ok(&["reconstruct", rig, "ball", "-o", out.to_str().unwrap(), "--truth", truth.to_str().unwrap()]);
    let text = std::fs::read_to_string(Path::new(&out).join("result.json")).unwrap();
    let result: Value = serde_json::from_str(&text).unwrap();
    let found = &result["method"]["flash_offset_mm"];
    let found = std::array::from_fn(|i| found[i].as_f64().unwrap_or_else(|| panic!("{found}")));
    (found, answer["summary"]["metrics"]["body"]["depth_mm"]["mae"].as_f64().unwrap())
}

#[test]
fn a_flash_beside_the_film_is_found_and_its_shading_taken_out() {
    let ((nowhere, near), (beside, far)) = (scan(0.0), scan(12.0));
    // Nothing is found where nothing is.
    assert_eq!(nowhere, [0.0; 3]);
    // 12 mm to the right; along the light's direction, (170, -20, -640) mm, an offset has no effect.
    let toward: [f64; 3] = [170.0, -20.0, -640.0].map(|v| v / 662.5);
    let across: [f64; 3] = std::array::from_fn(|i| if i == 0 { 12.0 } else { 0.0 } - 12.0 * toward[0] * toward[i]);
    let off = (0..3).map(|i| (beside[i] - across[i]).powi(2)).sum::<f64>().sqrt();
    assert!(off < 3.0, "{beside:?} instead of {across:?}");
    // Uncorrected, the error is twice as large.
    assert!(far < 1.25 * near, "{far} with the flash beside, {near} without");
}
