//! Bumps of camera and projector after the sweep, found by the board: which of the two moved, how far, and what a
//! correction leaves.

use std::path::Path;

use nelu3d_sim::Spec;
use nelu3d_sim::spec::{BumpSpec, SceneSpec};
use serde_json::Value;

use super::common::{calibrated, copy, nelu3d, stderr};

/// What was bumped, and by how many pixels along x.
#[derive(Clone, Copy)]
enum Bumped {
    Light(f64),
    Camera(f64),
}

const BUMPS: [(&str, Bumped); 6] = [
    ("light-0.3", Bumped::Light(0.3)),
    ("light-1", Bumped::Light(-1.0)),
    ("light-5", Bumped::Light(5.0)),
    ("camera-0.3", Bumped::Camera(-0.3)),
    ("camera-1", Bumped::Camera(1.0)),
    ("camera-5", Bumped::Camera(-5.0)),
];

/// Scenes after every bump: the board alone at a place of the sweep, and the vase alone; and the vase before the board.
fn spec() -> Spec {
    let mut spec =
        Spec::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/program/mistakes/rig.toml"))).unwrap();
    let vase = spec.scenes.remove(0);
    let mut both = BumpSpec::default();
    let mut add = |name: &str, bump: Option<BumpSpec>| {
        let board =
            SceneSpec { board: Some("005".into()), bump, ..SceneSpec::new(&format!("board-{name}"), Vec::new()) };
        spec.scenes.push(board);
        spec.scenes.push(SceneSpec { name: format!("vase-{name}"), bump, ..vase.clone() });
    };
    add("none", None);
    for (name, bumped) in BUMPS {
        let bump = match bumped {
            Bumped::Light(px) => BumpSpec { light_px: [px, 0.0], ..BumpSpec::default() },
            Bumped::Camera(px) => BumpSpec { camera_px: [px, 0.0], ..BumpSpec::default() },
        };
        add(name, Some(bump));
        both.light_px[0] += bump.light_px[0] / 5.0;
        both.camera_px[0] -= bump.camera_px[0] / 5.0;
    }
    add("both", Some(both));
    let bump = Some(BumpSpec { light_px: [2.0, 0.0], ..BumpSpec::default() });
    spec.scenes.push(SceneSpec { name: "vase-before-board".into(), board: Some("011".into()), bump, ..vase });
    spec
}

/// Makes everything but some columns of a capture as dark as a camera's black.
fn leave_columns(dir: &Path, columns: std::ops::Range<usize>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|e| e == "png") {
            let raw = nelu3d_scan::image::decode(&file, None).unwrap();
            let nelu3d_scan::image::RawData::U16(codes) = raw.data else { panic!("{} has 16 bits", file.display()) };
            let mut image = nelu3d_scan::Image::new(raw.width, raw.height, 1);
            let linear = |(i, code): (usize, &u16)| match columns.contains(&(i % raw.width)) {
                true => (f32::from(*code) - 64.0) / (4095.0 - 64.0),
                false => 0.0,
            };
            image.data = codes.iter().enumerate().map(linear).collect();
            nelu3d_scan::image::write_png16(&file, &image, 64.0, 4095.0).unwrap();
        }
    }
}

fn answer(args: &[&str]) -> Value {
    let out = nelu3d(&[args, &["--json", "--quiet"]].concat());
    assert!(out.status.success(), "{args:?}: {}", stderr(&out));
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn a_bump_is_found_attributed_and_corrected() {
    let (_folder, rig) = calibrated(&spec());
    let rig = rig.to_str().unwrap();
    let corrected = format!("{rig}/corrected.safetensors");
    let error = |scene: &str, more: &[&str]| {
        let truth = format!("{rig}/scenes/{scene}/truth");
        let all = [&["reconstruct", rig, scene, "--truth", &truth, "--accept"][..], more].concat();
        answer(&all)["summary"]["metrics"]["body"]["depth_mm"]["median"].as_f64().unwrap()
    };
    let unbumped = error("vase-none", &[]);

    let still = answer(&["check", rig, "--drift", "board-none"]);
    assert_eq!((&still["verdict"], &still["drift"]["moved"]), (&"good".into(), &"nothing".into()), "{still}");
    assert!(still["drift"]["shift_px"].as_f64().unwrap() < 0.1, "{still}");

    for (name, bumped) in BUMPS {
        let board = format!("board-{name}");
        let found = answer(&["check", rig, "--drift", &board, "--correct", &corrected]);
        let (moved, px) = match bumped {
            Bumped::Light(px) => ("light", px),
            Bumped::Camera(px) => ("camera", px),
        };
        assert_eq!(
            (&found["drift"]["moved"], &found["warnings"][0]["code"]),
            (&moved.into(), &"drift".into()),
            "{name}"
        );
        let along_x = found["drift"]["direction_px"][0].as_f64().unwrap();
        assert!((along_x - px).abs() < 0.05 + 0.05 * px.abs(), "{name}: {along_x} instead of {px} px");
        let (scene, field) = (format!("vase-{name}"), ["--field", &corrected]);
        let (before, after) = (error(&scene, &[]), error(&scene, &field));
        assert!(before > 5.0 * unbumped, "{name}: {before} mm hardly differ from {unbumped} mm");
        assert!(after < 2.0 * unbumped, "{name}: {after} mm, without a bump {unbumped} mm");
    }

    // Two motions at once are no one's.
    let both = answer(&["check", rig, "--drift", "board-both"]);
    assert_eq!(both["drift"]["moved"], "unknown", "{both}");
}

/// A board behind the object is enough.
#[test]
fn a_scene_with_the_board_in_view_tells_by_itself() {
    let mut spec = spec();
    spec.scenes.retain(|s| s.name == "vase-before-board");
    let (folder, rig) = calibrated(&spec);
    let rig = rig.to_str().unwrap();
    let codes = |answer: &Value, of: &str| -> Vec<String> {
        answer[of].as_array().unwrap().iter().map(|f| f["code"].as_str().unwrap().to_owned()).collect()
    };
    let found = answer(&["reconstruct", rig, "vase-before-board"]);
    assert_eq!((&found["verdict"], codes(&found, "warnings")), (&"doubtful".into(), vec!["drift".into()]));
    assert_eq!(found["summary"]["method"]["drift"]["moved"], "light");
    let corrected = answer(&["reconstruct", rig, "vase-before-board", "--correct"]);
    assert_eq!((&corrected["verdict"], codes(&corrected, "notes")), (&"good".into(), vec!["drift".into()]));

    // So is a frame of a sequence, keyframe or not.
    let frames = folder.path().join("frames");
    for frame in ["000", "001"] {
        copy(&Path::new(rig).join("scenes/vase-before-board"), &frames.join(frame));
    }
    let output = folder.path().join("moving");
    let moving = answer(&["sequence", rig, frames.to_str().unwrap(), "-o", output.to_str().unwrap()]);
    assert_eq!((&moving["verdict"], &moving["warnings"]), (&"doubtful".into(), &serde_json::json!({ "drift": 2 })));

    // A few markers at the edge of the view are enough.
    let edge = folder.path().join("edge");
    copy(&Path::new(rig).join("scenes/vase-before-board"), &edge.join("000"));
    leave_columns(&edge.join("000"), 105..160);
    let output = folder.path().join("moving-edge");
    let moving = answer(&["sequence", rig, edge.to_str().unwrap(), "-o", output.to_str().unwrap()]);
    assert_eq!(moving["table"][0]["drift"]["moved"], "light", "{moving}");
    assert!(moving["warnings"]["drift"] == 1, "{moving}");

    // A board that moves between white image and patterns tells nothing, however far the pattern falls off.
    let frames = folder.path().join("carried");
    let positions = ["004", "005", "006", "007"].map(|p| Path::new(rig).join("calibration").join(p));
    for (i, of_patterns) in positions[..3].iter().enumerate() {
        let frame = frames.join(format!("{i:03}"));
        copy(of_patterns, &frame);
        std::fs::copy(positions[i + 1].join("white.png"), frame.join("white.png")).unwrap();
    }
    let output = folder.path().join("moving-carried");
    let moving = answer(&["sequence", rig, frames.to_str().unwrap(), "--accept", "-o", output.to_str().unwrap()]);
    assert_eq!(moving["notes"], serde_json::json!({ "drift-not-checked": 3 }), "{moving}");
    assert!(moving["warnings"].get("drift").is_none(), "{moving}");

    // Without a board there is nothing to correct by.
    let out = nelu3d(&["check", rig, "--drift", "calibration", "--quiet"]);
    assert_eq!(out.status.code(), Some(1), "{}", stderr(&out));
}
