use nelu3d::progress::StageTime;
use nelu3d::result::{ExtraFiles, Input, ResultMetadata, SavedResult, Summary, write};
use nelu3d::surface::{PixelStatus, Surface};
use nelu3d_scan::{Camera, image, npy};

/// A slanted plane of 8 × 6 pixels whose first column is dark.
fn plane() -> (Surface, Camera) {
    let (width, height) = (8, 6);
    let camera = Camera {
        distortion: nelu3d_scan::camera::Distortion::new(&[-0.1, 0.02, 1e-3, -1e-3, 0.0]).unwrap(),
        ..Camera::pinhole(width, height, 10.0, 11.0, 3.5, 2.5)
    };
    let n = width * height;
    let dark = |i: usize| i.is_multiple_of(width);
    let map = |f: fn(usize) -> f32| (0..n).map(|i| if dark(i) { f32::NAN } else { f(i) }).collect::<Vec<f32>>();
    let normals = (0..n).map(|i| if dark(i) { [f32::NAN; 3] } else { [0.6, 0.0, -0.8] }).collect();
    let result = Surface {
        width,
        height,
        depth: map(|i| 500.0 + (i % 8) as f32),
        normals,
        sigma: map(|_| 0.25),
        status: (0..n).map(|i| if dark(i) { PixelStatus::Underexposed } else { PixelStatus::Valid }).collect(),
        residual: map(|_| 0.01),
        ambient: map(|_| 0.5),
        white: nelu3d_scan::Image { width, height, channels: 1, data: vec![0.7; n] },
        mesh: nelu3d_scan::Mesh {
            vertices: vec![[0.0, 0.0, 500.0], [1.0, 0.0, 500.0], [0.0, 1.0, 500.0]],
            normals: Vec::new(),
            colors: Vec::new(),
            faces: vec![[0, 2, 1]],
        },
    };
    (result, camera)
}

fn summary(result: &Surface, camera: &Camera, metadata: &ResultMetadata) -> Summary {
    let stage = |name: &str, wall_secs, cpu_secs| StageTime { name: name.into(), wall_secs, cpu_secs };
    let stages = [stage("a", 1.0, 2.0), stage("b", 0.5, 0.25)];
    Summary::new(result, &serde_json::json!({ "seed": 7 }), &stages, camera, metadata)
}

#[test]
fn a_result_is_read_back_as_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let (result, camera) = plane();
    let target = dir.path().join("results/plane");
    let metadata = ResultMetadata { scene: "plane".into(), ..ResultMetadata::default() };
    // Twice: an earlier result is replaced.
    for extra in [ExtraFiles { obj: true, stl: true, glb: true, ..ExtraFiles::default() }, ExtraFiles::default()] {
        write(&result, &summary(&result, &camera, &metadata), extra, &target).unwrap();
        for (name, wanted) in [("mesh.obj", extra.obj), ("mesh.stl", extra.stl), ("mesh.glb", extra.glb)] {
            assert_eq!(target.join(name).exists(), wanted, "{name}");
        }
    }
    for name in ["mask.png", "points.ply", "mesh.ply", "ambient.png", "preview.png"] {
        assert!(std::fs::metadata(target.join(name)).unwrap().len() > 0, "{name}");
    }
    let saved = SavedResult::read(&target).unwrap();
    assert_eq!(saved.camera, camera);
    let bits = |m: &[f32]| m.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&saved.depth), bits(&result.depth));
    assert_eq!(bits(saved.normals.unwrap().as_flattened()), bits(result.normals.as_flattened()));
    assert_eq!(bits(&saved.sigma.unwrap()), bits(&result.sigma));
    let mask = image::decode(&target.join("mask.png"), Some((8, 6))).unwrap();
    let expected: Vec<u8> = (0..48).map(|i| if i % 8 == 0 { 0 } else { 255 }).collect();
    assert_eq!(mask.data, image::RawData::U8(expected));
}

#[test]
fn the_summary_has_its_documented_keys() {
    let (result, camera) = plane();
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("abc");
    std::fs::write(&file, "abc").unwrap();
    let metadata = ResultMetadata { inputs: vec![Input::of(&file).unwrap()], ..ResultMetadata::default() };
    let json = serde_json::to_value(summary(&result, &camera, &metadata)).unwrap();
    assert_eq!(json["format"], 1);
    assert_eq!((&json["wall_secs"], &json["cpu_secs"]), (&1.5.into(), &2.25.into()));
    assert_eq!((&json["pixels"]["total"], &json["pixels"]["kept"]), (&48.into(), &42.into()));
    assert_eq!(json["pixels"]["left"]["dark"], 6);
    assert_eq!(json["pixels"]["left"]["outside"], 0);
    assert_eq!((&json["depth_mm"]["min"], &json["depth_mm"]["max"]), (&501.0.into(), &507.0.into()));
    assert_eq!(json["method"]["seed"], 7);
    assert!(json["metrics"].is_null());
    // FIPS 180-2, the first test vector.
    let sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    assert_eq!((&json["inputs"][0]["sha256"], &json["inputs"][0]["bytes"]), (&sha256.into(), &3.into()));
    if cfg!(target_os = "linux") {
        assert!(json["peak_memory_bytes"].as_u64().unwrap() > 1 << 20);
    }
}

#[test]
fn a_broken_result_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let read = || SavedResult::read(dir.path()).unwrap_err().to_string();
    assert!(read().contains("no result.json"));
    std::fs::write(dir.path().join("result.json"), "{}").unwrap();
    assert!(read().contains("result.json") && read().contains("camera"), "{}", read());
    let (result, camera) = plane();
    let metadata = ResultMetadata::default();
    let target = dir.path().join("r");
    write(&result, &summary(&result, &camera, &metadata), ExtraFiles::default(), &target).unwrap();
    npy::write(&target.join("sigma.npy"), &[3, 2], &[0.0; 6]).unwrap();
    let e = SavedResult::read(&target).unwrap_err().to_string();
    assert!(e.contains("sigma.npy") && e.contains("[3, 2]"), "{e}");
}
