mod checksum;

use std::path::Path;

use nalgebra::{Point3, Vector3};
use nelu3d::color_field::checkpoint::CheckpointError;
use nelu3d::color_field::checkpoint::header::FORMAT;
use nelu3d::color_field::frame::{Center, FieldFrame};
use nelu3d::color_field::frequency::{FrequencyForm, FrequencySettings, Octaves};
use nelu3d::color_field::grid::Grid;
use nelu3d::color_field::hash::{HashForm, HashSettings};
use nelu3d::color_field::published::{PublishedForm, PublishedOptions, PublishedSettings};
use nelu3d::color_field::validity::{KnownAxes, Validity};
use nelu3d::color_field::{ColorField, DepthNoise, FieldMetadata, Form, ProjectorResidual, Quality, camera_key};
use nelu3d::sensor::NoiseModel;
use nelu3d_scan::Camera;

/// A field of two channels for a camera of 20 × 12 px.
pub(crate) fn field(form: Form) -> ColorField {
    let mut frame = FieldFrame::around(Point3::new(200.0, 0.0, 0.0), Point3::new(0.0, 0.0, 700.0), Vector3::x());
    frame.enclose(&Point3::new(-50.0, -40.0, 650.0));
    frame.enclose(&Point3::new(50.0, 40.0, 750.0));
    let mut validity = Validity::new(20, 12, 8, [2, 3, 2]);
    validity.add([3.0, 4.0], 690.0, [0.3, 0.4, 0.5]);
    validity.add([3.0, 4.0], 710.0, [0.3, 0.4, 0.6]);
    let metadata = FieldMetadata {
        blur: None,
        version: "0".into(),
        rig: "r".into(),
        set: "s".into(),
        images: vec!["a.png".into(), "b.png".into()],
        mono: Vec::new(),
        channels: 1,
        center: Center::Light,
        source: "sweep".into(),
        camera: camera_key(&Camera::pinhole(20, 12, 30.0, 30.0, 9.5, 5.5)),
        noise: NoiseModel { read: 1e-6, gain: 1e-4, darkest: None },
        dark: Vec::new(),
        crosstalk: None,
        cells_per_pixel: 1,
        step_mm: 5.0,
        // What was never measured is NaN, and JSON has none.
        quality: Some(Quality {
            held_out: vec!["3".into()],
            n: 0,
            psnr_db: f64::INFINITY,
            psnr_all_db: 30.0,
            ceiling_db: 40.0,
            depth_mm: f64::NAN,
            pose_mm: 0.1,
            pose_covariance: None,
            depth_by_support: None,
            gross: None,
            depth_noise: Some(DepthNoise { by_side: [1.0, 1.5, 2.0, 2.5], by_support: Vec::new() }),
            pixels: None,
        }),
        residual: None,
        warnings: Vec::new(),
        boards: Vec::new(),
        board_bend: None,
        corrected: Vec::new(),
        settings: serde_json::json!({ "seed": 1 }),
    };
    ColorField { frame, form, validity, metadata }
}

fn grid() -> ColorField {
    let mut grid = Grid::new([3, 4, 2], 2);
    grid.coeffs.iter_mut().enumerate().for_each(|(i, c)| *c = (i % 8) as f32 / 8.0);
    field(Form::Grid(grid))
}

fn hash() -> ColorField {
    let settings = HashSettings {
        cells: [8, 8, 2],
        n_levels: 2,
        log2_hashmap_size: 4,
        width: 8,
        coarsening: 2,
        epochs: 1.0,
        batch: 1,
    };
    field(Form::Hash(Box::new(HashForm::new(settings, 2, 1))))
}

fn frequency() -> ColorField {
    let settings = FrequencySettings::for_cells([4, 4, 2], Octaves::Supervised);
    field(Form::Frequency(Box::new(FrequencyForm::new(settings, 2, 1))))
}

fn published() -> ColorField {
    let options = PublishedOptions { levels: 3, log2_entries: 6, finest_cells: 64, units: 8, ..Default::default() };
    let settings = PublishedSettings::new([4, 4, 2], grid().frame, options);
    field(Form::Published(Box::new(PublishedForm::new(settings, 2, 1))))
}

fn bytes(field: &ColorField) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("f");
    field.save(&path).unwrap();
    std::fs::read(&path).unwrap()
}

fn load(bytes: &[u8]) -> Result<ColorField, CheckpointError> {
    ColorField::from_bytes(Path::new("some/field.safetensors"), bytes)
}

/// Returns the file with its description and the length of that changed, and without its checksum: what an earlier
/// version would have written.
fn described(bytes: &[u8], change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
    let n = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut outer: serde_json::Value = serde_json::from_slice(&bytes[8..8 + n]).unwrap();
    let mut inner: serde_json::Value = serde_json::from_str(outer["__metadata__"]["nelu3d"].as_str().unwrap()).unwrap();
    inner.as_object_mut().unwrap().remove("sha256");
    change(&mut inner);
    outer["__metadata__"]["nelu3d"] = inner.to_string().into();
    let mut header = outer.to_string().into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    let mut out = (header.len() as u64).to_le_bytes().to_vec();
    out.extend_from_slice(&header);
    out.extend_from_slice(&bytes[8 + n..]);
    out
}

#[test]
fn what_is_known_along_one_axis_is_read_back() {
    let mut partly = grid();
    partly.validity.axes = vec![0, 1];
    partly.validity.light_along([0.8, 0.4, 0.5], KnownAxes::only(1));
    let read = load(&bytes(&partly)).unwrap();
    assert_eq!(read.validity, partly.validity);
    assert!(read.validity.known_at([0.8, 0.4, 0.5]).has(1) && !read.validity.known_at([0.8, 0.4, 0.5]).is_all());
    // Without the channels' axes, such a mark says nothing.
    partly.validity.axes.clear();
    assert!(load(&bytes(&partly)).is_err());
    partly.validity.axes = vec![0, 2];
    assert!(load(&bytes(&partly)).is_err());
}

#[test]
fn what_the_field_is_off_by_is_known_of_positions_or_of_scenes() {
    let mut metadata = grid().metadata;
    // 30 dB where 40 are possible: 0.0316² is 0.01² of noise, and the rest.
    metadata.quality.as_mut().unwrap().psnr_db = 30.0;
    assert!((metadata.model_sigma(0.005) - 0.03).abs() < 1e-4);
    metadata.quality = None;
    assert!((metadata.model_sigma(0.005) - 0.01).abs() < 1e-6);
    metadata.residual = Some(ProjectorResidual { sigma: 0.05, noise_sigma: 0.03, pose_covariance: None });
    assert!((metadata.model_sigma(0.005) - 0.04).abs() < 1e-6);
    metadata.residual = Some(ProjectorResidual { sigma: 0.02, noise_sigma: 0.03, pose_covariance: None });
    assert_eq!(metadata.model_sigma(0.005), 0.005);
}

#[test]
fn a_field_is_read_back_as_it_was() {
    for original in [grid(), hash(), frequency(), published()] {
        let back = load(&bytes(&original)).unwrap();
        assert_eq!(back.frame, original.frame);
        assert_eq!(back.validity, original.validity);
        assert_eq!(back.metadata.camera, original.metadata.camera);
        match (&back.form, &original.form) {
            (Form::Grid(a), Form::Grid(b)) => assert_eq!(a, b),
            (Form::Hash(a), Form::Hash(b)) => assert_eq!((a.shape(), a.params()), (b.shape(), b.params())),
            (Form::Frequency(a), Form::Frequency(b)) => {
                assert_eq!((a.shape(), a.params()), (b.shape(), b.params()));
            }
            (Form::Published(a), Form::Published(b)) => {
                assert_eq!((a.shape(), a.params()), (b.shape(), b.params()));
            }
            _ => panic!("another form"),
        }
        let quality = back.metadata.quality.unwrap();
        assert!(quality.depth_mm.is_nan() && quality.ceiling_db == 40.0);
    }
}

#[test]
fn a_field_of_format_1_is_read_unless_its_hash_table_was_laid_out_otherwise() {
    let older = |field: &ColorField| described(&bytes(field), |json| json["format"] = 1.into());
    assert!(load(&older(&grid())).is_ok());
    let refused = load(&older(&hash())).unwrap_err().to_string();
    assert!(refused.contains("some/field.safetensors") && refused.contains("calibrate again"), "{refused}");
}

/// One flipped bit, in the tensors or in the numbers of the description, is noticed; a file without checksum is read.
#[test]
fn a_flipped_bit_is_noticed() {
    for field in [grid(), hash(), frequency(), published()] {
        let good = bytes(&field);
        let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
        let text = String::from_utf8(good[8..header].to_vec()).unwrap();
        let origin = 8 + text.find("origin").unwrap() + r#"origin\":["#.len();
        let flip = |i: usize, bit: u8| {
            let mut bad = good.clone();
            bad[i] ^= bit;
            bad
        };
        let in_tensors = (header..good.len()).step_by(((good.len() - header) / 40).max(1));
        for bad in in_tensors.map(|i| flip(i, 1 << (i % 8))).chain([flip(origin, 1)]) {
            let e = load(&bad).unwrap_err().to_string();
            assert!(e.contains("SHA-256 differs") && e.contains("calibrate again"), "{e}");
        }
        let old = load(&described(&good, |_| {})).unwrap();
        assert_eq!(old.validity, field.validity);
    }
}

#[test]
fn absurd_descriptions_are_refused() {
    let huge = u64::MAX / 2;
    type Change = Box<dyn Fn(&mut serde_json::Value)>;
    let set = |pointer: &'static str, value: serde_json::Value| -> Change {
        Box::new(move |json| *json.pointer_mut(pointer).unwrap_or_else(|| panic!("no {pointer}")) = value.clone())
    };
    let mut cases: Vec<(ColorField, Change)> = Vec::new();
    for value in [0.into(), huge.into(), u64::MAX.into(), (1u64 << 32).into(), (-1).into(), 2.5.into()] {
        let value: serde_json::Value = value;
        for pointer in ["/form/cells/0", "/form/cells/2", "/form/k"] {
            cases.push((grid(), set(pointer, value.clone())));
        }
        for pointer in ["/form/k", "/form/n_params", "/form/settings/cells/1", "/form/config/width"] {
            cases.push((hash(), set(pointer, value.clone())));
        }
        for pointer in ["/form/k", "/form/n_params", "/form/settings/cells/1", "/form/config/width"] {
            cases.push((frequency(), set(pointer, value.clone())));
        }
        for pointer in ["/form/k", "/form/n_params", "/form/settings/cells/1", "/form/settings/options/levels"] {
            cases.push((published(), set(pointer, value.clone())));
        }
        for pointer in ["/form/config/encoding/log2_hashmap_size", "/form/config/encoding/n_levels"] {
            cases.push((hash(), set(pointer, value.clone())));
        }
        for pointer in ["/validity/tiles/0", "/validity/cells/1", "/validity/tile_px", "/about/channels"] {
            cases.push((grid(), set(pointer, value.clone())));
        }
        cases.push((grid(), set("/about/camera/0", value)));
    }
    cases.push((grid(), set("/frame/hi/1", serde_json::json!(-1e9))));
    cases.push((grid(), set("/frame/lo/0", serde_json::Value::Null)));
    cases.push((grid(), set("/frame/kappa", serde_json::json!("x"))));
    cases.push((grid(), set("/frame/axes/0/0", serde_json::json!(0.5))));
    cases.push((grid(), set("/frame/axes", serde_json::json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]]))));
    cases.push((grid(), set("/about/camera", serde_json::json!([20, 12]))));
    cases.push((grid(), set("/about/images", serde_json::json!(["a.png"]))));
    cases.push((grid(), set("/about/noise/read", serde_json::json!(-1.0))));
    cases.push((published(), set("/form/settings/cube/side_mm", serde_json::json!(0.0))));
    cases.push((published(), set("/form/settings/frame/origin/0", serde_json::json!(1.0))));
    cases.push((grid(), set("/form", serde_json::json!({ "kind": "table" }))));
    for (i, (field, change)) in cases.iter().enumerate() {
        let e = load(&described(&bytes(field), change)).expect_err(&format!("case {i}")).to_string();
        assert!(e.starts_with("some/field.safetensors: ") && e.contains("calibrate again"), "case {i}: {e}");
    }
    let newer = load(&described(&bytes(&grid()), set("/format", (FORMAT + 1).into()))).unwrap_err().to_string();
    assert!(newer.contains("update nelu3d"), "{newer}");
}

#[test]
fn values_that_no_field_has_are_refused() {
    let Form::Grid(mut coeffs) = grid().form else { unreachable!("made as a grid") };
    coeffs.coeffs[7] = f32::NAN;
    let mut near = grid();
    near.validity.t_range[1] = [f32::NAN, 700.0];
    let mut behind = grid();
    behind.validity.t_range[1] = [-3.0, 700.0];
    for field in [field(Form::Grid(coeffs)), near, behind] {
        assert!(load(&bytes(&field)).is_err());
    }
}

/// Whatever is in the file, reading it ends with a field that can be used or with an error that names the file.
#[test]
fn damaged_files_never_panic() {
    let mut state = 99u64;
    let mut below = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    let mut refused = 0;
    // The checksum would refuse nearly all of them before anything else could.
    for good in [grid(), hash(), frequency(), published()].map(|f| described(&bytes(&f), |_| {})) {
        let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
        for round in 0..400 {
            let mut bad = good.clone();
            match round % 4 {
                // Damage anywhere, in the description, in the length, and a cut.
                0 => (0..=below(8)).for_each(|_| bad[below(good.len())] = below(256) as u8),
                1 => (0..=below(3)).for_each(|_| bad[below(header)] = b"0123456789-.,:[]{}\"e \\"[below(21)]),
                2 => bad[below(8)] = below(256) as u8,
                _ => bad.truncate(below(good.len())),
            }
            match load(&bad) {
                Ok(field) => {
                    let mut c = vec![0.0; field.k()];
                    field.to_grid().eval([0.2, 0.5, 0.9], &mut c);
                    field.validity.range(19, 11);
                    field.validity.is_lit([0.2, 0.5, 0.9]);
                }
                Err(e) => {
                    refused += 1;
                    assert!(e.to_string().starts_with("some/field.safetensors: "), "{e}");
                }
            }
        }
    }
    assert!(refused > 800, "only {refused} of 1600 were refused");
}
