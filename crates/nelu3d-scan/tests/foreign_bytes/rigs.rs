//! rig.toml, camera and projector files.

use std::path::Path;

use nelu3d_scan::board::{Board, BoardKind};
use nelu3d_scan::camera::{Distortion, camera_from_bytes, projector_from_bytes, write_camera, write_projector};
use nelu3d_scan::image::Channels;
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::{Camera, Projector, Rig};
use proptest::collection::{hash_set, vec};
use proptest::prelude::*;
use proptest::sample::select;

use super::mutation::{arbitrary, changes, damaged};
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

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn damaged_rigs_are_refused_or_read(markers: bool, changes in changes()) {
        read_rig(damaged(if markers { MARKERS } else { RIG }.as_bytes(), &changes));
    }

    #[test]
    fn damaged_cameras_are_refused_or_read(which in 0usize..4, changes in changes()) {
        read_camera(&damaged(CAMERAS[which].as_bytes(), &changes));
    }

    #[test]
    fn arbitrary_bytes_are_no_rig(
        bytes in arbitrary(&[b"", b"format = 1\n[camera]\n", b"{\"K\": ", b"K: ", b"a: &a [*a]\n"])
    ) {
        read_camera(&bytes);
        read_rig(bytes);
    }

    #[test]
    fn arbitrary_text_is_no_rig(text in "[ -~\\n]{0,200}", brackets in "[\\[\\]{}:,\\- \\n]{0,200}") {
        for text in [text, brackets] {
            read_camera(text.as_bytes());
            read_rig(text.into_bytes());
        }
    }
}

fn camera() -> impl Strategy<Value = Camera> {
    let coeffs = select(vec![0usize, 4, 5, 8, 12, 14]).prop_flat_map(|n| vec(-0.5f64..0.5, n));
    // In units of the longer side, as far as a lens can go.
    (1usize..9000, 1usize..9000, [0.051f64..999.0, 0.051..999.0, -99.0..99.0, -99.0..99.0], coeffs).prop_map(
        |(width, height, optics, coeffs)| {
            let [fx, fy, cx, cy] = optics.map(|v| v * width.max(height) as f64);
            let distortion = Distortion::new(&coeffs).unwrap();
            Camera { distortion, ..Camera::pinhole(width, height, fx, fy, cx, cy) }
        },
    )
}

/// A name that a person could type.
fn name() -> impl Strategy<Value = String> {
    "[a-zA-Z0-9_äß\"'#=-][a-zA-Z0-9_äß\"' .#=-]{0,12}x"
}

proptest! {
    #![proptest_config(cases(100))]

    #[test]
    fn cameras_round_trip(
        camera in camera(),
        turn in [-1.0f64..1.0, -1.0..1.0, -1.0..1.0],
        shift in [-1e3f64..1e3, -1e3..1e3, -1e3..1e3],
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_camera(&path, &camera).unwrap();
        prop_assert_eq!(&camera_from_bytes(&path, &std::fs::read(&path).unwrap()).unwrap(), &camera);
        let proj_from_cam = nalgebra::Isometry3::new(shift.into(), turn.into());
        let projector = Projector { optics: camera, proj_from_cam };
        write_projector(&path, &projector).unwrap();
        let back = projector_from_bytes(&path, &std::fs::read(&path).unwrap()).unwrap();
        prop_assert_eq!(&back.optics, &projector.optics);
        prop_assert_eq!(back.proj_from_cam.translation, projector.proj_from_cam.translation);
        // A quaternion that has gone through a matrix.
        prop_assert!(back.proj_from_cam.rotation.angle_to(&proj_from_cam.rotation) < 1e-7);
    }

    #[test]
    fn rigs_round_trip(
        (title, set) in ("[a-zA-Z0-9_äß\"'\\\\ .#=-]{0,12}", name()),
        channels in select(Channels::ALL.to_vec()),
        (black_level, range) in (0.0f64..1e4, 1e-3f64..1e5),
        names in hash_set(name(), 8),
        (columns, rows, square_mm) in (3usize..30, 3usize..30, 1e-2f64..1e3),
    ) {
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
        prop_assert_eq!(Rig::open(dir.path()).unwrap(), rig);
    }
}
