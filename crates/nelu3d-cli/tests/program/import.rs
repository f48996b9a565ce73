//! `nelu3d import` as it is typed: a recording becomes a rig that `check` has nothing to say against.

use std::fs;
use std::path::Path;

use nelu3d_scan::image::{Image, write_png16};
use nelu3d_scan::{Camera, Rig};

use super::common::nelu3d;

const W: usize = 16;
const H: usize = 12;

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("text")
}

/// `n` frames, pattern and white in turn, 12 bits in 16; and intrinsics.
fn record(dir: &Path, n: usize) {
    fs::create_dir(dir.join("frames")).unwrap();
    for i in 0..n {
        let value = if i % 2 == 0 { 0.3 } else { 0.8 };
        let image = Image { data: vec![value; W * H], ..Image::new(W, H, 1) };
        write_png16(&dir.join(format!("frames/f{}.png", i + 1)), &image, 0.0, 4095.0).unwrap();
    }
    nelu3d_scan::camera::write_camera(&dir.join("camera.json"), &Camera::pinhole(W, H, 30.0, 30.0, 7.5, 5.5)).unwrap();
}

#[test]
fn a_recording_becomes_a_rig() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path(), 25);
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (frames, rig, camera) = (path("frames"), path("rig"), path("camera.json"));
    let new = ["--order", "pattern,white", "--camera", &camera, "--channels", "mono", "--saturation", "4095"];
    let out = nelu3d(&[&["import", &frames, &rig, "--sequence", "ball", "--json", "--quiet"][..], &new].concat());
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("warning: ") && text(&out.stderr).contains("the last 1 of 25 frames"));
    let answer: serde_json::Value = serde_json::from_str(&text(&out.stdout)).unwrap();
    assert_eq!((answer["folders"].as_u64(), answer["left_over"].as_u64()), (Some(12), Some(1)));
    assert_eq!((answer["new_rig"].as_bool(), answer["channels"].as_str()), (Some(true), Some("mono")));

    let out = nelu3d(&["import", &frames, &rig, "--scene", "cup", "--mean", "--first", "1", "--last", "10"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let shown = text(&out.stdout);
    assert!(shown.contains("f1.png to f10.png") && shown.contains("the mean of 5 groups"), "{shown}");
    assert!(shown.contains("order     pattern.png, white.png") && !shown.contains("new rig"), "{shown}");

    let opened = Rig::open(Path::new(&rig)).unwrap();
    assert_eq!(opened.sequence("ball").unwrap().len(), 12);
    let check = nelu3d(&["check", &rig]);
    assert_eq!(check.status.code(), Some(0), "{}", text(&check.stdout));
}

#[test]
fn what_does_not_fit_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path(), 4);
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (frames, rig, camera, none) = (path("frames"), path("rig"), path("camera.json"), path("no-such-folder"));
    let cases: [(&[&str], &str); 4] = [
        (&[&none, &rig, "--calibration"], "no-such-folder"),
        (&[&frames, &rig, "--calibration"], "--camera"),
        (&[&frames, &rig, "--calibration", "--camera", &camera, "--order", "pattern,white"], "--channels"),
        (&[&frames, &rig, "--scene", "x", "--camera", &camera, "--channels", "mono", "--order", "a,white"], "--mean"),
    ];
    for (args, expected) in cases {
        let out = nelu3d(&[&["import", "--quiet"], args].concat());
        assert_eq!(out.status.code(), Some(1), "{args:?}");
        let said = text(&out.stderr);
        assert!(
            said.starts_with("nelu3d: ") && said.trim_end().lines().count() == 1 && said.contains(expected),
            "{said}"
        );
        assert!(out.stdout.is_empty() && !Path::new(&rig).exists(), "{args:?}");
    }
}
