//! `nelu3d camera`: cameras of virtual rigs from their own sweeps and from folders of images, and what is refused.

use std::fs;
use std::path::{Path, PathBuf};

use super::common::{nelu3d, stderr};
use nelu3d_scan::Camera;
use nelu3d_scan::camera::read_camera;
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{DepthSpacing, SweepSpec};

/// The film scanner's camera and charuco board, held by hand at 16 positions, partly outside the picture.
fn handheld() -> Spec {
    let mut spec = Spec::preset("color").expect("a preset");
    spec.sweep = SweepSpec::Handheld {
        positions: 16,
        first_mm: 600.0,
        last_mm: 800.0,
        center_mm: [0.0; 2],
        position_sigma_mm: 15.0,
        tilt_sigma: 0.35,
        depths: DepthSpacing::Scattered,
        max_tilt: Some(0.7),
        min_in_view: 0.6,
        hands: None,
        write_poses: false,
    };
    spec.pattern_sets.clear();
    spec.scenes.clear();
    spec.sequences.clear();
    spec
}

fn run(arguments: &[&str]) -> Result<serde_json::Value, String> {
    let out = nelu3d(&[&["camera", "--json", "--quiet"], arguments].concat());
    match out.status.code() {
        Some(0) => Ok(serde_json::from_slice(&out.stdout).unwrap()),
        Some(1) => {
            let said = stderr(&out);
            // The log may have spoken before.
            let last = said.trim_end().lines().last().unwrap_or_default();
            assert!(last.starts_with("nelu3d: ") && said.matches("nelu3d: ").count() == 1, "{said}");
            Err(last.to_owned())
        }
        _ => panic!("{}", stderr(&out)),
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn assert_close(found: &Camera, truth: &Camera) {
    for (a, b, limit) in [
        (found.fx, truth.fx, 1e-3 * truth.fx),
        (found.fy, truth.fy, 1e-3 * truth.fy),
        (found.cx, truth.cx, 1.0),
        (found.cy, truth.cy, 1.0),
    ] {
        assert!((a - b).abs() < limit, "{found:?} {truth:?}");
    }
}

/// The white images of a rig in one folder, and its board in a file.
fn images_of(rig: &Path, dir: &Path) -> (PathBuf, PathBuf) {
    let images = dir.join("images");
    fs::create_dir(&images).unwrap();
    for entry in fs::read_dir(rig.join("calibration")).unwrap() {
        let entry = entry.unwrap();
        let name = format!("{}.png", entry.file_name().to_str().unwrap());
        fs::copy(entry.path().join("white.png"), images.join(name)).unwrap();
    }
    let toml = fs::read_to_string(rig.join("rig.toml")).unwrap();
    let board = dir.join("board.toml");
    fs::write(&board, &toml[toml.find("[board]").unwrap()..]).unwrap();
    (images, board)
}

#[test]
fn a_rig_calibrates_its_camera_from_its_own_sweep() {
    let (dir, rig) = super::common::simulated(&handheld());
    let file = rig.join("camera.json");
    let truth = read_camera(&file).unwrap();
    // It is not overwritten unless asked.
    let error = run(&[text(&rig)]).unwrap_err();
    assert!(error.contains("camera.json: exists; give --force"), "{error}");
    assert_eq!(read_camera(&file).unwrap(), truth);
    fs::remove_file(&file).unwrap();

    let answer = run(&[text(&rig)]).unwrap();
    let found = read_camera(&file).unwrap();
    eprintln!("{found:?}\n{}", answer["report"]["models"]);
    assert_close(&found, &truth);
    let views = answer["report"]["views"].as_array().unwrap();
    assert!(views.len() >= 14 && views.iter().all(|v| v["tilt_deg"].as_f64().unwrap() < 60.0));
    // The rig is one that opens now.
    assert!(nelu3d_scan::Rig::open(&rig).is_ok());

    // The same images in a folder give the same camera, where nothing tells levels and colors: nearly so.
    let (images, board) = images_of(&rig, dir.path());
    let output = dir.path().join("folder.json");
    let corners = dir.path().join("corners.json");
    let arguments = [text(&images), "--board", text(&board), "-o", text(&output), "--corners", text(&corners)];
    run(&[&arguments[..], &["--leave-out", "003.png"]].concat()).unwrap();
    assert_close(&read_camera(&output).unwrap(), &truth);
    let corners: serde_json::Value = serde_json::from_str(&fs::read_to_string(&corners).unwrap()).unwrap();
    assert!(corners["003.png"].as_array().unwrap().len() > 10);

    // One image of another size.
    let odd = images.join("999.png");
    nelu3d_scan::image::write_gray8(&odd, 20, 10, &[100; 200]).unwrap();
    let error = run(&[&arguments[..], &["--force"]].concat()).unwrap_err();
    assert!(error.contains("999.png: has 20 x 10 pixels, but the first image has"), "{error}");
    fs::remove_file(odd).unwrap();
    let error = run(&[text(&images)]).unwrap_err();
    assert!(error.contains("give the board that its images show with --board"), "{error}");
    let error = run(&[&arguments[..], &["--force", "--leave-out", "nobody"]].concat()).unwrap_err();
    assert!(error.contains("there is no image `nobody`"), "{error}");
    let error = run(&[text(dir.path()), "--board", text(&board), "-o", text(&dir.path().join("n.json"))]).unwrap_err();
    assert!(error.contains("has no images"), "{error}");
}

/// A stage whose board faces the camera says nothing about the focal length: one sentence, and no file.
#[test]
fn boards_that_face_the_camera_are_refused() {
    let mut spec = handheld();
    spec.sweep = Spec::preset("color").unwrap().sweep;
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("the preset's board is on a stage") };
    *positions = 8;
    let (_dir, rig) = super::common::simulated(&spec);
    let file = rig.join("camera.json");
    fs::remove_file(&file).unwrap();
    let error = run(&[text(&rig)]).unwrap_err();
    eprintln!("{error}");
    assert!(error.contains("the focal length cannot be determined") && error.contains("tilt the board"), "{error}");
    assert!(!file.exists());
}
