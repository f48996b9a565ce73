use std::fs;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use nelu3d_scan::camera::{CameraFileError, Distortion, read_camera, read_projector, write_camera, write_projector};
use nelu3d_scan::{Camera, Projector};

fn camera_with(distortion: &[f64]) -> Camera {
    Camera {
        distortion: Distortion::new(distortion).unwrap(),
        ..Camera::pinhole(640, 480, 1502.3, 1500.8, 322.4, 236.9)
    }
}

fn read_text(name: &str, text: &str) -> Result<Camera, CameraFileError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    fs::write(&path, text).unwrap();
    read_camera(&path)
}

fn complaint(name: &str, text: &str) -> String {
    let message = read_text(name, text).unwrap_err().to_string();
    assert!(message.contains(name), "the file is not named: {message}");
    message
}

const LOOKUP3D: &str = r#"{"resx": 640, "resy": 480, "K": [[1502.3,0,322.4],[0,1500.8,236.9],[0,0,1]],
    "dist_coeffs": [-0.081, 0.062, 0.0006, -0.0009, 0.01]}"#;

const OPENCV_YAML: &str = "%YAML:1.0
---
calibration_time: \"Mon 01 Jan 2024\"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1.5023e+03, 0., 3.224e+02, 0., 1500.8,
       236.9, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.081, .062, 0.0006, -9.0e-04, 1e-2 ]
";

const OPENCV_JSON: &str = r#"{"image_width": 640, "image_height": 480,
    "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d",
        "data": [1502.3, 0.0, 322.4, 0.0, 1500.8, 236.9, 0.0, 0.0, 1.0]},
    "distortion_coefficients": {"type_id": "opencv-matrix", "rows": 1, "cols": 5, "dt": "d",
        "data": [-0.081, 0.062, 0.0006, -0.0009, 0.01]}}"#;

const ROS_YAML: &str = "image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [1502.3, 0, 322.4, 0, 1500.8, 236.9, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.081, 0.062, 0.0006, -0.0009, 0.01]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
";

const ROS_MESSAGE: &str = "header: {seq: 1, frame_id: camera}
height: 480
width: 640
distortion_model: plumb_bob
D: [-0.081, 0.062, 0.0006, -0.0009, 0.01]
K: [1502.3, 0.0, 322.4, 0.0, 1500.8, 236.9, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
";

#[test]
fn every_format_gives_the_same_camera() {
    let expected = camera_with(&[-0.081, 0.062, 0.0006, -0.0009, 0.01]);
    for (name, text) in [
        ("camera.json", LOOKUP3D),
        ("opencv.yml", OPENCV_YAML),
        ("opencv.json", OPENCV_JSON),
        ("ros.yaml", ROS_YAML),
        ("message.yaml", ROS_MESSAGE),
    ] {
        assert_eq!(read_text(name, text).unwrap(), expected, "{name}");
    }
}

#[test]
fn cameras_and_projectors_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.json");
    for n in [0, 4, 5, 8, 12, 14] {
        let coeffs: Vec<f64> = (0..n).map(|i| 0.013 * (f64::from(i) - 3.7)).collect();
        let camera = camera_with(&coeffs);
        write_camera(&path, &camera).unwrap();
        assert_eq!(read_camera(&path).unwrap(), camera);

        let proj_from_cam =
            Isometry3::new(Vector3::new(-210.3, 16.4, 59.0), Vector3::new(0.03, 0.3, -0.02 * f64::from(n)));
        let projector = Projector { optics: camera, proj_from_cam };
        write_projector(&path, &projector).unwrap();
        let back = read_projector(&path).unwrap();
        assert_eq!(back.optics, projector.optics);
        assert_eq!(back.proj_from_cam.translation, proj_from_cam.translation);
        assert!(back.proj_from_cam.rotation.angle_to(&proj_from_cam.rotation) < 1e-12);
    }
}

#[test]
fn a_rodrigues_vector_is_a_rotation_too() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("projector.json");
    let with = |r: &str, t: &str| LOOKUP3D.replace("0.01]}", &format!("0.01], \"R\": {r}, \"T\": {t}}}"));
    // A quarter turn about z, in OpenCV's column shape.
    fs::write(&path, with("[[0], [0], [1.5707963267948966]]", "[1, 2, 3]")).unwrap();
    let p = read_projector(&path).unwrap();
    let q = p.proj_from_cam * nalgebra::Point3::new(1.0, 0.0, 0.0);
    assert!((q - nalgebra::Point3::new(1.0, 3.0, 3.0)).norm() < 1e-12);

    for (r, t, key) in [
        ("[[1,0,0],[0,1,0],[0,0,-1]]", "[0,0,0]", "`R` is no rotation"),
        ("[[2,0,0],[0,1,0],[0,0,1]]", "[0,0,0]", "`R` is no rotation"),
        ("[1,2]", "[0,0,0]", "`R` has 2 numbers"),
        ("[0,0,0]", "[0,0]", "`T` has 2 numbers"),
        ("[0,0,0]", "[0,0,NaN]", "`T` holds NaN"),
    ] {
        fs::write(&path, with(r, t)).unwrap();
        let e = read_projector(&path).unwrap_err().to_string();
        assert!(e.contains(key) && e.contains("projector.json"), "{e}");
        assert!(read_camera(&path).is_err());
    }
    fs::write(&path, LOOKUP3D).unwrap();
    assert!(read_projector(&path).unwrap_err().to_string().contains("has no `R`"));
}

#[test]
fn impossible_values_are_named() {
    for (from, to, expected) in [
        ("1502.3", "0", "`K` has the focal length fx = 0"),
        ("1500.8", "-1500.8", "`K` has the focal length fy = -1500.8"),
        ("1502.3", "NaN", "`K` holds NaN"),
        ("1502.3", "1.0", "`K` has the focal length fx = 1.0 px, for images of up to 640 px; give it in pixels"),
        ("1500.8", "1e300", "`K` has the focal length fy = 1e300 px"),
        ("1500.8", "-1e300", "`K` has the focal length fy = -1e300; a focal length is positive"),
        ("322.4", "-1e300", "has its principal point at (-1e300, 236.9) px, far outside"),
        ("236.9", "-Infinity", "`K` holds -inf"),
        ("1502.3,0,", "1502.3,0.5,", "`K` is"),
        ("[0,0,1]", "[0,0]", "`K` has 8 numbers"),
        ("322.4", "\"left\"", "`K` holds \"left\""),
        ("-0.081, ", "", ""),
        ("-0.081, 0.062, ", "", "`dist_coeffs` has 3 coefficients"),
        ("\"resx\": 640, ", "", "has no `resx`"),
        ("640", "640.5", "`resx` is not a whole number"),
        ("480", "0", "`resy` is 0"),
        ("\"dist_coeffs\"", "\"distortion\"", "has no `dist_coeffs`"),
    ] {
        let text = LOOKUP3D.replacen(from, to, 1);
        if expected.is_empty() {
            assert!(read_text("camera.json", &text).is_ok(), "four coefficients are fine");
        } else {
            let e = complaint("camera.json", &text);
            assert!(e.contains(expected), "{e} instead of {expected}");
        }
    }
}

#[test]
fn other_formats_complain_in_their_own_words() {
    assert!(
        complaint("a.yml", &OPENCV_YAML.replace("rows: 5", "rows: 4")).contains("`distortion_coefficients` says 4x1")
    );
    assert!(complaint("a.yml", &OPENCV_YAML.replace("1.5023e+03", ".Nan")).contains("`camera_matrix` holds NaN"));
    assert!(complaint("a.yml", &OPENCV_YAML.replace("image_width", "w")).contains("has no `image_width`"));
    assert!(
        complaint("a.yaml", &ROS_YAML.replace("plumb_bob", "equidistant"))
            .contains("`distortion_model` is equidistant")
    );
    let nan_json = OPENCV_JSON.replace("1502.3", ".Nan");
    assert!(complaint("a.json", &nan_json).contains("`camera_matrix` holds NaN"));
    assert_eq!(read_text("a.json", &OPENCV_JSON.replace("1.0]", "1.]")).unwrap().fx, 1502.3, "OpenCV's short floats");
    assert!(complaint("a.json", "{\"resx\": 640,").contains("not valid JSON"));
    assert!(complaint("a.yaml", "a: [1, 2").contains("not valid YAML"));
    assert!(complaint("a.yaml", "just words").contains("has no `K`"));
    assert!(complaint("a.json", "{}").contains("has no `K`"));
    assert!(complaint("a.json", "").contains("has no `K`"));
    let e = read_camera(Path::new("/no/such/camera.json")).unwrap_err().to_string();
    assert!(e.contains("/no/such/camera.json"), "{e}");
}

/// Whatever is in the file, reading it ends with a camera or with an error that names the file.
#[test]
fn damaged_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cam.json");
    let mut state = 5u64;
    let mut below = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    let mut refused = 0;
    for good in [LOOKUP3D, OPENCV_YAML] {
        for round in 0..300 {
            let mut bad = good.as_bytes().to_vec();
            match round % 3 {
                0 => (0..=below(6)).for_each(|_| bad[below(good.len())] = below(256) as u8),
                1 => (0..=below(6)).for_each(|_| bad[below(good.len())] = b"0123456789-.,:[]{}\"e \\&*!|>"[below(27)]),
                _ => bad.truncate(below(good.len())),
            }
            fs::write(&path, &bad).unwrap();
            match read_camera(&path) {
                Ok(camera) => assert!(camera.fx > 0.0 && camera.n_pixels() > 0),
                Err(e) => {
                    refused += 1;
                    assert!(e.to_string().contains("cam.json"), "{e}");
                }
            }
        }
    }
    assert!(refused > 300, "only {refused} of 600 were refused");
}

#[test]
fn deep_nesting_is_refused_at_once() {
    let start = std::time::Instant::now();
    for open in ["[", "{\"a\":", "- ", "? ", "{"] {
        let message = complaint("cam.yaml", &open.repeat(100_000));
        assert!(message.contains("nested too deeply"), "{message}");
    }
    assert!(start.elapsed().as_secs() < 5);
}
