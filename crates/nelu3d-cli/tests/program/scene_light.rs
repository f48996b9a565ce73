//! What changes the codewords of a whole scene: a flash beside the patterns' light, and a little crosstalk.

use std::path::Path;

use nelu3d_sim::Spec;
use nelu3d_sim::spec::LightSpec;
use serde_json::Value;

use super::common::{nelu3d, simulated, small, stderr};

/// No crosstalk.
const NONE: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// So little that most of the misfit is noise.
const LITTLE: [[f64; 3]; 3] = [[0.9, 0.09, 0.01], [0.07, 0.86, 0.07], [0.02, 0.1, 0.88]];

/// A ball with stripes of color under color film, with the flash so many millimeters to the right of the film's lamp.
fn spec(offset_mm: f64, mixing: [[f64; 3]; 3]) -> Spec {
    let mut spec = small("color");
    spec.camera.color_mixing = mixing;
    let LightSpec::Film(film) = &mut spec.light else { panic!("film") };
    film.flash_offset_mm = [offset_mm, 0.0, 0.0];
    let ball = "name = \"ball\"\nblack = false\n[[objects]]\nposition_mm = [0.0, 0.0, 735.0]\nshape = { kind = \"sphere\", \
                radius_mm = 72.0 }\nalbedo = { kind = \"waves\", from = [0.85, 0.6, 0.35], to = [0.4, 0.7, 0.8], period_mm = \
                45.0 }\n";
    spec.scenes.push(toml::from_str(ball).expect("a scene"));
    spec
}

/// What the ball's scan finds: the flash's offset, mm, the crosstalk, and the mean error of its body, mm.
fn scan(spec: &Spec) -> ([f64; 3], [[f64; 3]; 3], f64) {
    let (dir, rig) = simulated(spec);
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
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{}", result["method"]));
    let method = &result["method"];
    let offset = std::array::from_fn(|i| number(&method["flash_offset_mm"][i]));
    let mixing = std::array::from_fn(|i| std::array::from_fn(|j| number(&method["mixing_left"][i][j])));
    (offset, mixing, number(&answer["summary"]["metrics"]["body"]["depth_mm"]["mae"]))
}

#[test]
fn a_flash_beside_the_film_and_a_little_crosstalk_are_found_and_taken_out() {
    // Nothing is found where nothing is.
    let (offset, mixing, least) = scan(&spec(0.0, NONE));
    assert_eq!((offset, mixing), ([0.0; 3], NONE));

    let (offset, mixing, error) = scan(&spec(12.0, LITTLE));
    // 12 mm to the right; along the light's direction, (170, -20, -640) mm, an offset has no effect.
    let toward: [f64; 3] = [170.0, -20.0, -640.0].map(|v| v / 662.5);
    let across: [f64; 3] = std::array::from_fn(|i| if i == 0 { 12.0 } else { 0.0 } - 12.0 * toward[0] * toward[i]);
    let off = (0..3).map(|i| (offset[i] - across[i]).powi(2)).sum::<f64>().sqrt();
    assert!(off < 2.0, "{offset:?} instead of {across:?}");
    for (i, j) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
        let (found, truth) = (mixing[i][j], LITTLE[i][j]);
        assert!((found - truth).abs() < 0.04, "{i},{j}: {found} of {truth}");
    }
    assert!(error < 1.25 * least, "{error} where there is both, {least} without");
}
