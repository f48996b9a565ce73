//! A camera that is not linear: its response is measured through a rehearsed capture and from files, and a scan with it
//! is nearly as good as a linear camera's.

use std::fs;
use std::path::{Path, PathBuf};

use super::common::{nelu3d, simulated, stderr};
use nelu3d_scan::Rig;
use nelu3d_scan::image::{Raw, RawData, Response, decode, write_raw_png};
use nelu3d_scan::pattern::{Alacarte, Axis, Pattern, Superposition};
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{BlackImage, LightSpec, PatternSetSpec, SweepSpec};
use serde_json::Value;

const GAMMA: f64 = 2.2;

/// What a webcam of 8 bits makes of an image of a linear camera.
fn webcam(from: &Path, to: &Path, rig: &Rig) {
    let raw = decode(from, None).unwrap();
    let RawData::U16(codes) = &raw.data else { panic!("16 bits") };
    let scale = 1.0 / (rig.saturation - rig.black_level);
    let code = |c: &u16| {
        let light = (scale * (f64::from(*c) - rig.black_level)).clamp(0.0, 1.0);
        (255.0 * light.powf(1.0 / GAMMA)).round() as u8
    };
    let data = RawData::U8(codes.iter().map(code).collect());
    fs::create_dir_all(to.parent().unwrap()).unwrap();
    write_raw_png(to, &Raw { data, ..raw }).unwrap();
}

fn images(folder: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(folder).unwrap().map(|f| f.unwrap().path());
    files.filter(|f| f.extension().is_some_and(|e| e == "png")).collect()
}

/// So many positions are enough.
fn stage(spec: &mut Spec, n: usize) {
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("a stage") };
    *positions = n;
}

/// Simulates the scanner, and the same one showing the images whose light adds up; returns the linear rig and a
/// webcam's, with its folder `response`.
fn rigs(dir: &Path) -> (PathBuf, PathBuf) {
    let mut spec = Spec::preset("demo").unwrap();
    spec.supersampling = 2;
    stage(&mut spec, 12);
    let (linear, source) = (dir.join("linear"), dir.join("source"));
    nelu3d_sim::simulate(&spec, &linear, &|_, _, _| {}).unwrap();
    let superposition = vec![Pattern::Superposition(Superposition::default())];
    spec.pattern_sets = vec![PatternSetSpec { name: "superposition".into(), patterns: superposition }];
    stage(&mut spec, 3);
    let LightSpec::Projector(projector) = &mut spec.light else { panic!("a projector") };
    // Its gamma is its own affair, and black is what it shows as such.
    (projector.gamma, projector.black) = (1.8.into(), BlackImage::Darkest);
    let shown = dir.join("shown");
    nelu3d_sim::simulate(&spec, &shown, &|_, _, _| {}).unwrap();
    let rig = Rig::open(&linear).unwrap();
    for part in ["calibration", "scenes"] {
        for folder in fs::read_dir(linear.join(part)).unwrap().map(|f| f.unwrap().path()) {
            for file in images(&folder) {
                webcam(&file, &source.join(file.strip_prefix(&linear).unwrap()), &rig);
            }
        }
    }
    for file in images(&shown.join("scenes/vase")) {
        webcam(&file, &source.join("response").join(file.file_name().unwrap()), &rig);
    }
    super::common::copy(&linear.join("patterns"), &source.join("patterns"));
    Rig { root: source.clone(), black_level: 0.0, saturation: 255.0, ..rig }.save().unwrap();
    (linear, source)
}

fn answer(args: &[&str]) -> Value {
    let out = nelu3d(&[args, &["--json", "--quiet"]].concat());
    assert!(out.status.success(), "{args:?}: {}", stderr(&out));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// Largest error of a curve over the codes that a webcam has of lit surfaces.
fn error(response: &Response) -> f64 {
    let codes = (20..=200).map(|c| f64::from(c) / 255.0);
    // Normalized intensities do not depend on what the curve is measured by.
    let fixed = |f: &dyn Fn(f64) -> f64, c: f64| (f(c) - f(0.08)) / (f(0.78) - f(0.08));
    let truth = |c: f64| c.powf(GAMMA);
    codes.map(|c| (fixed(&|c| response.light(c), c) - fixed(&truth, c)).abs()).fold(0.0, f64::max)
}

#[test]
fn a_webcam_whose_response_was_measured_scans_as_a_linear_camera() {
    let dir = tempfile::tempdir().unwrap();
    let (linear, source) = rigs(dir.path());
    let (rig, path) = (dir.path().join("rig"), |p: &Path| p.to_str().unwrap().to_owned());
    let taken = answer(&["capture", &path(&rig), "--rehearse", &path(&source), "--response", "measure"]);
    assert_eq!(taken["response"]["name"], "response.json", "{taken}");
    let opened = Rig::open(&rig).unwrap();
    let measured = opened.response.clone().unwrap();
    assert!(error(&measured) < 0.01, "{}: {}", error(&measured), taken["response"]);

    // The same images as files of a rig that says something else.
    fs::copy(source.join("rig.toml"), rig.join("rig.toml")).unwrap();
    let text = fs::read_to_string(rig.join("rig.toml")).unwrap();
    fs::write(rig.join("rig.toml"), text.replace("[camera]", "[camera]\nresponse = \"linear\"")).unwrap();
    let out = nelu3d(&["camera", &path(&rig), "--response"]);
    assert!(stderr(&out).contains("--force") && out.status.code() == Some(1), "{}", stderr(&out));
    let again = answer(&["camera", &path(&rig), "--response", "--force"]);
    assert_eq!(again["response"], "response.json");
    assert_eq!(Rig::open(&rig).unwrap().response, Some(measured.clone()));
    // And as those of a folder that is no rig.
    let file = path(&dir.path().join("curve.json"));
    answer(&["camera", &path(&source.join("response")), "--response", "-o", &file]);
    let read = Response::from_json("response.json", &fs::read(&file).unwrap()).unwrap();
    assert_eq!(read, measured);

    let scan = |rig: &Path| {
        answer(&["calibrate", &path(rig)]);
        let truth = path(&linear.join("scenes/vase/truth"));
        let said = answer(&["reconstruct", &path(rig), "vase", "--truth", &truth, "--accept"]);
        said["summary"]["metrics"]["body"]["depth_mm"]["median"].as_f64().unwrap()
    };
    let (of_linear, of_webcam) = (scan(&linear), scan(&rig));
    println!("body median: linear {of_linear:.4} mm, webcam {of_webcam:.4} mm");
    assert!(of_webcam < 1.5 * of_linear, "{of_webcam} mm, not {of_linear} mm");
}

#[test]
fn what_does_not_tell_the_response_is_said_in_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().to_str().unwrap();
    let gray = |name: &str, code: u8| {
        let raw = Raw { width: 320, height: 240, channels: 1, data: RawData::U8(vec![code; 320 * 240]) };
        write_raw_png(&dir.path().join(name), &raw).unwrap();
    };
    let refused = |args: &[&str], what: &str| {
        let out = nelu3d(&[&["-q", "camera", path, "--response"], args].concat());
        let text = stderr(&out);
        assert_eq!(out.status.code(), Some(1), "{args:?}: {text}");
        assert!(text.trim_end().lines().count() == 1 && text.contains(what), "{args:?}: {text}");
        assert!(fs::read_dir(dir.path()).unwrap().all(|f| f.unwrap().path().extension().unwrap() == "png"));
    };
    (0..3).for_each(|i| gray(&format!("{i}.png"), 40 << i));
    refused(&[], "superposition_00");
    refused(&["--exposures", "1,2"], "3 images");
    // Light doubled twice, and codes hardly rose.
    [150, 170, 190].into_iter().enumerate().for_each(|(i, code)| gray(&format!("{i}.png"), code));
    refused(&["--exposures", "1/4,1/2,1"], "does not add up");
    (0..21).for_each(|i| gray(&format!("superposition_{i:02}.png"), 170));
    gray("black.png", 4);
    refused(&[], "does not add up");
}

/// Finds the response of a projector, v^1.8, on the boards of a sweep, and scans with it. From a scene alone v^2.2
/// comes out: under three à la carte patterns a wrong response and wrong depths explain the images as well.
#[test]
fn a_sweep_tells_the_response_of_a_calibrated_projector() {
    let mut spec = Spec::preset("demo").unwrap();
    spec.supersampling = 2;
    let LightSpec::Projector(projector) = &mut spec.light else { panic!("a projector") };
    projector.gamma = 1.8.into();
    let alacarte = Pattern::Alacarte(Alacarte { axis: Axis::X, count: 3, ..Alacarte::default() });
    spec.pattern_sets = vec![PatternSetSpec { name: "alacarte".into(), patterns: vec![alacarte] }];
    stage(&mut spec, 4);
    let (dir, rig) = simulated(&spec);
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (rig, field, result) = (rig.to_str().unwrap(), at("field.safetensors"), at("result"));
    let calibrated = answer(&["calibrate", rig, "--from-projector", "-o", &field]);
    let said = calibrated["report"]["frame"].as_str().unwrap();
    let exponent = said.split("v^").nth(1).and_then(|v| v.split(' ').next()).unwrap().parse::<f64>().unwrap();
    assert!((exponent - 1.8).abs() < 0.1 && said.contains("from 4 boards"), "{said}");
    let truth = format!("{rig}/scenes/vase/truth");
    answer(&["reconstruct", rig, "vase", "--field", &field, "--truth", &truth, "-o", &result]);
    let summary: Value = serde_json::from_slice(&fs::read(Path::new(&result).join("result.json")).unwrap()).unwrap();
    let median = summary["metrics"]["body"]["depth_mm"]["median"].as_f64().unwrap();
    assert!(median < 1.0, "{median} mm");
}

/// The middle of the picture of a projector with a shifted lens does not meet the middle of the view anywhere near the
/// scene: here at 1.4 m instead of 0.7. Boards tell where the field is wanted, and scenes do without boards.
#[test]
fn a_shifted_lens_throws_its_picture_beside_the_scene() {
    let mut spec = Spec::preset("demo").unwrap();
    spec.supersampling = 2;
    let LightSpec::Projector(projector) = &mut spec.light else { panic!("a projector") };
    projector.width = 1000;
    stage(&mut spec, 3);
    let (dir, rig) = simulated(&spec);
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (path, field, result) = (rig.to_str().unwrap(), at("field.safetensors"), at("result"));
    let truth = format!("{path}/scenes/vase/truth");
    for source in ["from 3 boards", "from a scene"] {
        let calibrated = answer(&["calibrate", path, "--from-projector", "-o", &field]);
        assert!(calibrated["report"]["frame"].as_str().unwrap().contains(source), "{calibrated}");
        answer(&["reconstruct", path, "vase", "--field", &field, "--truth", &truth, "-o", &result]);
        let summary: Value =
            serde_json::from_slice(&fs::read(Path::new(&result).join("result.json")).unwrap()).unwrap();
        let body = &summary["metrics"]["body"];
        let (median, coverage) = (body["depth_mm"]["median"].as_f64().unwrap(), body["coverage"].as_f64().unwrap());
        assert!(median < 0.3 && coverage > 0.95, "{source}: {median} mm, {coverage}");
        // The second time without a sweep.
        let _ = fs::rename(rig.join("calibration"), rig.join("boards"));
    }
}

/// A projector that was calibrated two millimeters beside where it is: its field is wrong by that, boards tell, and the
/// verdict and 1σ say it.
#[test]
fn boards_tell_that_a_projector_is_not_where_it_is_said_to_be() {
    let mut spec = Spec::preset("demo").unwrap();
    spec.supersampling = 2;
    stage(&mut spec, 4);
    let (dir, rig) = simulated(&spec);
    let file = rig.join("projector.json");
    let mut projector: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    projector["T"][0] = Value::from(projector["T"][0].as_f64().unwrap() + 2.0);
    fs::write(&file, projector.to_string()).unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (rig, field, result) = (rig.to_str().unwrap(), at("field.safetensors"), at("result"));
    let calibrated = answer(&["calibrate", rig, "--from-projector", "--accept", "-o", &field]);
    let said: Vec<&str> =
        calibrated["warnings"].as_array().unwrap().iter().filter_map(|w| w["code"].as_str()).collect();
    assert!(said == ["projector-disagrees"], "{said:?}");
    let truth = format!("{rig}/scenes/vase/truth");
    let scanned =
        answer(&["reconstruct", rig, "vase", "--accept", "--field", &field, "--truth", &truth, "-o", &result]);
    assert_eq!(scanned["warnings"][0]["code"], "field-doubtful");
    let summary: Value = serde_json::from_slice(&fs::read(Path::new(&result).join("result.json")).unwrap()).unwrap();
    let body = &summary["metrics"]["body"];
    let number = |pointer: &str| body.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    let (median, within) = (number("/depth_mm/median"), number("/sigma/within_2"));
    println!("a projector 2 mm off: median error {median:.2} mm, {within:.2} within 2 sigma");
    assert!(median > 0.5 && within > 0.9, "{median} mm, {within}");
}
