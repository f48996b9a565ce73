//! rig.toml, camera and projector files.

use std::path::Path;

use nelu3d_scan::board::{Board, BoardKind};
use nelu3d_scan::camera::{Distortion, camera_from_bytes, projector_from_bytes, write_camera, write_projector};
use nelu3d_scan::image::Channels;
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::{Camera, Projector, Rig};
use rand::RngExt;
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;

use super::mutation::{arbitrary, damaged};
use super::{cases, watched};

const RIG: &str = r#"format = 1
name = "a rig"
[camera]
intrinsics = "camera.json"
channels = "bayer-grbg"
black_level = 64.0
saturation = 4095.0
[images]
white = "white.png"
black = "black.png"
[[pattern_sets]]
name = "sine"
images = ["a.png", "b.png"]
inverse = ["c.png", "d.png"]
[board]
kind = "charuco"
columns = 9
rows = 12
square_mm = 20.0
marker_mm = 15.0
dictionary = "DICT_5X5_250"
legacy = true
extent_mm = [-5, -5.0, 185, 245]
[[poses]]
position = "0000"
rotation = [0.1, -0.2, 0.3]
translation = [1e1, 2.0, 5e2]
"#;

const MARKERS: &str = r#"format = 1
[camera]
channels = "mono"
black_level = 0
saturation = 255
[board]
kind = "markers"
dictionary = "DICT_4X4_50"
markers = [
  { id = 3, corners_mm = [[0, 0], [10, 0], [10, 10], [0, 10]] },
  { id = 4, corners_mm = [[20, 0], [30, 0], [30, 10], [20, 10]] },
]
"#;

const CAMERAS: [&str; 4] = [
    r#"{"resx": 640, "resy": 480, "K": [[900, 0, 320], [0, 900, 240], [0, 0, 1]], "dist_coeffs": [0.1, 0, 0, 0, 0],
        "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [100, 0, 0]}"#,
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n\
     \x20  data: [ 9.0e+02, 0., 320., 0., 900., 240., 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n\
     \x20  cols: 5\n   dt: d\n   data: [ -0.1, 0.05, 0., 0., 0. ]\n",
    "image_width: 640\nimage_height: 480\ncamera_name: left\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [900, 0, 320, \
     0, 900, 240, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n\
     \x20 rows: 1\n  cols: 5\n  data: [0, 0, 0, 0, 0]\n",
    "height: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: [0, 0, 0, 0, 0]\n\
     K: [900, 0, 320, 0, 900, 240, 0, 0, 1]\n",
];

fn pinhole() -> Camera {
    Camera::pinhole(640, 480, 900.0, 900.0, 320.0, 240.0)
}

fn read_rig(bytes: Vec<u8>) -> bool {
    watched(|| Rig::from_bytes(Path::new("rig"), bytes, pinhole(), None)).is_ok()
}

fn read_camera(bytes: &[u8]) -> bool {
    let _ = watched(|| projector_from_bytes(Path::new("projector.json"), bytes));
    watched(|| camera_from_bytes(Path::new("camera.json"), bytes)).is_ok()
}

#[test]
fn the_files_to_be_damaged_are_good() {
    assert!(read_rig(RIG.into()) && read_rig(MARKERS.into()));
    assert!(CAMERAS.iter().all(|c| read_camera(c.as_bytes())));
}

#[test]
fn damaged_rigs_are_refused_or_read() {
    cases(1000, |rng| {
        let file = if rng.random() { MARKERS } else { RIG };
        read_rig(damaged(file.as_bytes(), rng));
    });
}

#[test]
fn damaged_cameras_are_refused_or_read() {
    cases(1000, |rng| {
        let file = CAMERAS.choose(rng).expect("files");
        read_camera(&damaged(file.as_bytes(), rng));
    });
}

#[test]
fn arbitrary_bytes_are_no_rig() {
    cases(1000, |rng| {
        let beginnings: [&[u8]; 5] = [b"", b"format = 1\n[camera]\n", b"{\"K\": ", b"K: ", b"a: &a [*a]\n"];
        let bytes = arbitrary(&beginnings, rng);
        read_camera(&bytes);
        read_rig(bytes);
    });
}

#[test]
fn arbitrary_text_is_no_rig() {
    let printable: String = (' '..='~').chain(['\n']).collect();
    cases(1000, |rng| {
        for text in [text(&printable, 200, rng), text("[]{}:,- \n", 200, rng)] {
            read_camera(text.as_bytes());
            read_rig(text.into_bytes());
        }
    });
}

/// Up to `most` of some characters.
fn text(characters: &str, most: usize, rng: &mut StdRng) -> String {
    let characters: Vec<char> = characters.chars().collect();
    (0..rng.random_range(0..=most)).map(|_| *characters.choose(rng).expect("some")).collect()
}

fn camera(rng: &mut StdRng) -> Camera {
    let n = *[0, 4, 5, 8, 12, 14].choose(rng).expect("some");
    let coeffs: Vec<f64> = (0..n).map(|_| rng.random_range(-0.5..0.5)).collect();
    let (width, height): (usize, usize) = (rng.random_range(1..9000), rng.random_range(1..9000));
    // In units of the longer side, as far as a lens can go.
    let longer = width.max(height) as f64;
    let [fx, fy] = std::array::from_fn(|_| longer * rng.random_range(0.051..999.0));
    let [cx, cy] = std::array::from_fn(|_| longer * rng.random_range(-99.0..99.0));
    let distortion = Distortion::new(&coeffs).unwrap();
    Camera { distortion, ..Camera::pinhole(width, height, fx, fy, cx, cy) }
}

const LETTERS: &str = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_äß\"'#=-";

/// A name that a person could type.
fn name(rng: &mut StdRng) -> String {
    let letters: Vec<char> = LETTERS.chars().collect();
    let first = letters.choose(rng).expect("some");
    format!("{first}{}x", text(&format!("{LETTERS} ."), 12, rng))
}

#[test]
fn cameras_round_trip() {
    cases(100, |rng| {
        let camera = camera(rng);
        let turn: [f64; 3] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        let shift: [f64; 3] = std::array::from_fn(|_| rng.random_range(-1e3..1e3));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_camera(&path, &camera).unwrap();
        assert_eq!(&camera_from_bytes(&path, &std::fs::read(&path).unwrap()).unwrap(), &camera);
        let proj_from_cam = nalgebra::Isometry3::new(shift.into(), turn.into());
        let projector = Projector { optics: camera, proj_from_cam };
        write_projector(&path, &projector).unwrap();
        let back = projector_from_bytes(&path, &std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(&back.optics, &projector.optics);
        assert_eq!(back.proj_from_cam.translation, projector.proj_from_cam.translation);
        // A quaternion that has gone through a matrix.
        assert!(back.proj_from_cam.rotation.angle_to(&proj_from_cam.rotation) < 1e-7);
    });
}

#[test]
fn rigs_round_trip() {
    cases(100, |rng| {
        let title = text(&format!("{LETTERS}\\ ."), 12, rng);
        let set = name(rng);
        let channels = *Channels::ALL.choose(rng).expect("some");
        let (black_level, range) = (rng.random_range(0.0..1e4), rng.random_range(1e-3..1e5));
        let mut names: Vec<String> = Vec::new();
        while names.len() < 8 {
            let next = name(rng);
            if !names.contains(&next) {
                names.push(next);
            }
        }
        let (columns, rows) = (rng.random_range(3..30), rng.random_range(3..30));
        let square_mm = rng.random_range(1e-2..1e3);
        let dir = tempfile::tempdir().unwrap();
        let mut names = names.into_iter();
        let mut next = || names.next().expect("eight names");
        let (white, black) = (next(), next());
        let (images, inverse) = (vec![next(), next(), next()], vec![next(), next(), next()]);
        let kind = BoardKind::Chessboard { columns, rows, square_mm };
        let extent_mm = [0.0, 0.0, columns as f64 * square_mm, rows as f64 * square_mm];
        let rig = Rig {
            root: dir.path().into(),
            name: title,
            camera: pinhole(),
            camera_file: "camera.json".into(),
            channels,
            response: None,
            black_level,
            saturation: black_level + range,
            white,
            black,
            pattern_sets: vec![PatternSet { name: set, inverse, images }],
            board: Some(Board { kind, extent_mm, scale: [1.0, 1.0] }),
            poses: Vec::new(),
            projector: None,
            memory: None,
        };
        rig.save().unwrap();
        assert_eq!(Rig::open(dir.path()).unwrap(), rig);
    });
}
