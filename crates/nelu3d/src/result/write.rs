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
