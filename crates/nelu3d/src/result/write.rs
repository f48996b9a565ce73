//! Writing a result folder.

use std::io;
use std::path::Path;

use nelu3d_scan::mesh::{MeshFileError, write_points};
use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::{image, npy};
use rayon::prelude::*;

use super::extra::{ExtraFiles, position};
use super::picture::{colors_of, preview};
use super::summary::Summary;
use crate::surface::Surface;

/// The error of a result folder that could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The folder or one of its files could not be written; the message names it.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A mesh file could not be written.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
}

/// Writes a result folder, whole or not at all; an earlier result of that name is replaced. The folder then holds, but
/// for `report.html`, which the program adds:
///
/// | file | content |
/// |---|---|
/// | `depth.npy` | float32, height × width, mm, NaN = none |
/// | `normals.npy` | float32, height × width × 3, facing the camera, NaN = none |
/// | `sigma.npy` | float32, height × width, 1σ of the depth in mm, NaN = none |
/// | `mask.png` | 255 where there is depth |
/// | `points.ply` | one point per pixel that has depth, with normal, color, and σ |
/// | `mesh.ply` | the surface |
/// | others | on request: [`ExtraFiles`] |
/// | `ambient.png` | 16 bit, 65535 = all light is ambient, 0 where there is none |
/// | `preview.png` | capture, shaded surface, colored depth |
/// | `result.json` | [`Summary`] |
///
/// # Errors
///
/// A file cannot be written, or `dir` exists and is no result.
pub fn write(r: &Surface, summary: &Summary, extra: ExtraFiles, dir: &Path) -> Result<(), WriteError> {
    let folder = OutputDir::create(dir, "result.json")?;
    write_into(folder.path(), r, summary, extra)?;
    Ok(folder.commit()?)
}

/// Writes the files of a result into a folder that exists, for callers that add files of their own before it is renamed
/// to its final name.
///
/// # Errors
///
/// A file cannot be written.
///
/// # Panics
///
/// If the maps differ in size.
pub fn write_into(dir: &Path, r: &Surface, summary: &Summary, extra: ExtraFiles) -> Result<(), WriteError> {
    let (w, h) = (r.width, r.height);
    let lengths = [r.depth.len(), r.normals.len(), r.sigma.len(), r.status.len(), r.residual.len(), r.ambient.len()];
    assert!(lengths.iter().all(|&n| n == w * h), "maps of {lengths:?} values for {w} × {h} pixels");
    let preview = preview(r);
    let compressed = || write_atomic(&dir.join("preview.png"), |w| w.write_all(&preview.png()));
    let (others, compressed) = rayon::join(|| write_others(dir, r, summary, extra), compressed);
    others?;
    compressed?;
    write_atomic(&dir.join("result.json"), |w| Ok(serde_json::to_writer_pretty(w, summary)?))?;
    Ok(())
}

/// Writes what a result has but for its preview and its summary.
fn write_others(dir: &Path, r: &Surface, summary: &Summary, extra: ExtraFiles) -> Result<(), WriteError> {
    let (w, h) = (r.width, r.height);
    npy::write(&dir.join("depth.npy"), &[h, w], &r.depth)?;
    npy::write(&dir.join("normals.npy"), &[h, w, 3], r.normals.as_flattened())?;
    npy::write(&dir.join("sigma.npy"), &[h, w], &r.sigma)?;
    let mask: Vec<u8> = r.depth.iter().map(|z| if z.is_finite() { 255 } else { 0 }).collect();
    image::write_gray8(&dir.join("mask.png"), w, h, &mask)?;
    drop(mask);
    // NaN, where there is no depth, becomes 0.
    let ambient: Vec<u16> = r.ambient.iter().map(|a| (65535.0 * f64::from(*a)).round() as u16).collect();
    image::write_gray16(&dir.join("ambient.png"), w, h, &ambient)?;
    drop(ambient);
    write_point_cloud(&dir.join("points.ply"), r, summary)?;
    r.mesh.write(&dir.join("mesh.ply"))?;
    let camera = summary.camera.camera().expect("made from a camera");
    extra.write(dir, r, &camera)?;
    Ok(())
}

/// Writes one point per pixel that has depth: position, normal, its color in the white image, and σ.
fn write_point_cloud(path: &Path, r: &Surface, summary: &Summary) -> io::Result<()> {
    let camera = summary.camera.camera().expect("made from a camera");
    let valid: Vec<usize> = (0..r.depth.len()).filter(|&i| r.depth[i].is_finite()).collect();
    let positions: Vec<[f32; 3]> = valid.par_iter().map(|&i| position(r, &camera, i)).collect();
    let normals: Vec<[f32; 3]> = valid.iter().map(|&i| r.normals[i]).collect();
    let colors: Vec<[u8; 3]> = valid.iter().copied().map(colors_of(&r.white)).collect();
    let sigma: Vec<f32> = valid.iter().map(|&i| r.sigma[i]).collect();
    write_points(path, &positions, &normals, &colors, &sigma)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::StageTime;
    use crate::result::{Input, ResultMetadata, SavedResult};
    use crate::surface::PixelStatus;
    use nelu3d_scan::Camera;

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
}
