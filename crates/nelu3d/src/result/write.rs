//! The result folder.

use std::io;
use std::path::Path;

use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::{Camera, Mesh, image, mesh, npy};

use super::picture::{Picture, preview};
use super::{About, Reconstruction, Summary};

/// Mesh files to write besides mesh.ply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshFiles {
    /// Wavefront, mesh.obj.
    pub obj: bool,
    /// Stereolithography, mesh.stl.
    pub stl: bool,
    /// Binary glTF, mesh.glb.
    pub glb: bool,
}

/// Writes a result folder, whole or not at all; an earlier result of that name is replaced. Everything but
/// `report.html`, which the program adds:
///
/// | file | content |
/// |---|---|
/// | `depth.npy` | float32, height × width, mm, NaN = none |
/// | `normals.npy` | float32, height × width × 3, facing the camera, NaN = none |
/// | `sigma.npy` | float32, height × width, 1σ of the depth in mm, NaN = none |
/// | `mask.png` | 255 where there is depth |
/// | `points.ply` | one point per pixel that has depth, with normal and color |
/// | `mesh.ply` | the surface; `mesh.obj`, `mesh.stl`, `mesh.glb` on request |
/// | `ambient.png` | 16 bit, 65535 = all light is ambient, 0 where there is none |
/// | `preview.png` | capture, shaded surface, colored depth |
/// | `result.json` | [`Summary`] |
///
/// # Errors
///
/// A file cannot be written, or `dir` exists and is no result.
pub fn write(r: &Reconstruction, camera: &Camera, about: &About, mesh_files: MeshFiles, dir: &Path) -> io::Result<()> {
    let folder = OutputDir::create(dir, "result.json")?;
    write_into(folder.path(), r, &Summary::new(r, camera, about), mesh_files)?;
    folder.commit()
}

/// The same into a folder that exists, for callers that add files of their own before it is put into place.
///
/// # Errors
///
/// A file cannot be written.
///
/// # Panics
///
/// When the maps differ in size.
pub fn write_into(dir: &Path, r: &Reconstruction, summary: &Summary, mesh_files: MeshFiles) -> io::Result<()> {
    let (w, h) = (r.width, r.height);
    let lengths = [r.depth.len(), r.normals.len(), r.sigma.len(), r.left.len(), r.residual.len(), r.ambient.len()];
    assert!(lengths.iter().all(|&n| n == w * h), "maps of {lengths:?} values for {w} × {h} pixels");
    npy::write(&dir.join("depth.npy"), &[h, w], &r.depth)?;
    npy::write(&dir.join("normals.npy"), &[h, w, 3], r.normals.as_flattened())?;
    npy::write(&dir.join("sigma.npy"), &[h, w], &r.sigma)?;
    let mask: Vec<u8> = r.depth.iter().map(|z| if z.is_finite() { 255 } else { 0 }).collect();
    image::write_gray8(&dir.join("mask.png"), w, h, &mask)?;
    let ambient = image::Image {
        width: w,
        height: h,
        channels: 1,
        data: r.ambient.iter().map(|a| if a.is_finite() { *a } else { 0.0 }).collect(),
    };
    image::write_png16(&dir.join("ambient.png"), &ambient, 0.0, 65535.0)?;
    mesh::write(&dir.join("points.ply"), &points(r, summary))?;
    mesh::write(&dir.join("mesh.ply"), &r.mesh)?;
    for (wanted, name) in [(mesh_files.obj, "mesh.obj"), (mesh_files.stl, "mesh.stl"), (mesh_files.glb, "mesh.glb")] {
        if wanted {
            mesh::write(&dir.join(name), &r.mesh)?;
        }
    }
    write_atomic(&dir.join("preview.png"), |w| w.write_all(&preview(r).png()))?;
    write_atomic(&dir.join("result.json"), |w| Ok(serde_json::to_writer_pretty(w, summary)?))
}

/// One point per pixel that has depth: position, normal, and its color in the white image.
fn points(r: &Reconstruction, summary: &Summary) -> Mesh {
    let camera = summary.camera.camera().expect("made from a camera");
    let color = Picture::of_image(&r.white);
    let kept: Vec<usize> = (0..r.depth.len()).filter(|&i| r.depth[i].is_finite()).collect();
    let position = |&i: &usize| {
        let ray = camera.ray([(i % r.width) as f64, (i / r.width) as f64]);
        let p = ray.at(f64::from(r.depth[i]) / ray.dir.z);
        [p.x as f32, p.y as f32, p.z as f32]
    };
    Mesh {
        vertices: kept.iter().map(position).collect(),
        normals: kept.iter().map(|&i| r.normals[i]).collect(),
        colors: kept.iter().map(|&i| color.rgb(i)).collect(),
        faces: Vec::new(),
    }
}
