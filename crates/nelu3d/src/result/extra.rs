//! Files of a result on request: the surface, its points, and its depth as other programs read them.

use std::io;
use std::path::Path;

use nelu3d_scan::Camera;
use nelu3d_scan::cloud::{OrganizedCloud, write_e57, write_pcd};
use nelu3d_scan::image::{write_exr_f32, write_tiff_f32};
use nelu3d_scan::mesh::{TexturedMesh, write_textured_glb, write_textured_obj};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::picture::{Picture, colors_of};
use crate::surface::Surface;

/// Files to write besides those that every result has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExtraFiles {
    /// Wavefront, mesh.obj.
    pub obj: bool,
    /// Stereolithography, mesh.stl.
    pub stl: bool,
    /// Binary glTF, mesh.glb: meters, y up.
    pub glb: bool,
    /// 3D Manufacturing Format, mesh.3mf.
    pub threemf: bool,
    /// Wavefront with the flash as its picture, textured.obj, textured.mtl, and textured.png.
    pub textured_obj: bool,
    /// Binary glTF with the flash as its picture, textured.glb: meters, y up.
    pub textured_glb: bool,
    /// Point Cloud Library, points.pcd: one point a pixel, with σ.
    pub pcd: bool,
    /// E57, points.e57: meters, with rows, columns, and σ.
    pub e57: bool,
    /// TIFF, depth.tiff: 32-bit floats, mm.
    pub tiff: bool,
    /// OpenEXR, depth.exr: channel Z, 32-bit floats, mm.
    pub exr: bool,
}

impl ExtraFiles {
    /// Names of all of them, as options and arguments have them.
    pub const NAMES: [&str; 10] =
        ["obj", "stl", "glb", "3mf", "textured-obj", "textured-glb", "pcd", "e57", "tiff", "exr"];

    /// Adds the file of a name; false if there is none of that name.
    pub fn add(&mut self, name: &str) -> bool {
        let wanted = match name {
            "obj" => &mut self.obj,
            "stl" => &mut self.stl,
            "glb" => &mut self.glb,
            "3mf" => &mut self.threemf,
            "textured-obj" => &mut self.textured_obj,
            "textured-glb" => &mut self.textured_glb,
            "pcd" => &mut self.pcd,
            "e57" => &mut self.e57,
            "tiff" => &mut self.tiff,
            "exr" => &mut self.exr,
            _ => return false,
        };
        *wanted = true;
        true
    }

    /// Writes them into a folder.
    ///
    /// # Errors
    ///
    /// A file cannot be written; the message names it.
    pub fn write(&self, dir: &Path, r: &Surface, camera: &Camera) -> io::Result<()> {
        let meshes =
            [(self.obj, "mesh.obj"), (self.stl, "mesh.stl"), (self.glb, "mesh.glb"), (self.threemf, "mesh.3mf")];
        for (_, name) in meshes.into_iter().filter(|(wanted, _)| *wanted) {
            r.mesh.write(&dir.join(name))?;
        }
        if self.textured_obj || self.textured_glb {
            let (uv, png) = (texture_coordinates(r, camera), Picture::of_image(&r.white).png());
            let textured = TexturedMesh { mesh: &r.mesh, uv: &uv, png: &png };
            if self.textured_obj {
                write_textured_obj(&dir.join("textured.obj"), &textured)?;
            }
            if self.textured_glb {
                write_textured_glb(&dir.join("textured.glb"), &textured)?;
            }
        }
        if self.pcd || self.e57 {
            let cloud = cloud(r, camera);
            if self.pcd {
                write_pcd(&dir.join("points.pcd"), &cloud)?;
            }
            if self.e57 {
                write_e57(&dir.join("points.e57"), &cloud, &guid(&r.depth))?;
            }
        }
        if self.tiff {
            write_tiff_f32(&dir.join("depth.tiff"), r.width, r.height, &r.depth)?;
        }
        if self.exr {
            write_exr_f32(&dir.join("depth.exr"), r.width, r.height, "Z", &r.depth)?;
        }
        Ok(())
    }
}

/// Returns the point of a pixel, mm, camera frame; NaN where there is no depth.
pub fn position(r: &Surface, camera: &Camera, i: usize) -> [f32; 3] {
    if !r.depth[i].is_finite() {
        return [f32::NAN; 3];
    }
    let ray = camera.ray([(i % r.width) as f64, (i / r.width) as f64]);
    let p = ray.at(f64::from(r.depth[i]) / ray.dir.z);
    [p.x as f32, p.y as f32, p.z as f32]
}

/// Returns the surface as a cloud with the camera's grid.
fn cloud(r: &Surface, camera: &Camera) -> OrganizedCloud {
    let n = r.depth.len();
    OrganizedCloud {
        width: r.width,
        height: r.height,
        positions: (0..n).into_par_iter().map(|i| position(r, camera, i)).collect(),
        normals: r.normals.clone(),
        colors: (0..n).map(colors_of(&r.white)).collect(),
        sigma: r.sigma.clone(),
    }
}

/// Returns where in the flash each vertex of the mesh is, 0 to 1 from the outer edges of the first column and row.
pub fn texture_coordinates(r: &Surface, camera: &Camera) -> Vec<[f32; 2]> {
    let at = |v: &[f32; 3]| {
        // Pixel centers lie at integers, so that the picture begins at -0.5.
        let [x, y] = camera.project(&v.map(f64::from).into()).unwrap_or_default();
        [((x + 0.5) / r.width as f64) as f32, ((y + 0.5) / r.height as f64) as f32]
    };
    r.mesh.vertices.iter().map(at).collect()
}

/// Returns a name for the content: the same depth has the same.
pub fn guid(depth: &[f32]) -> String {
    let hash = Sha256::digest(bytemuck::cast_slice::<f32, u8>(depth));
    let hex: String = hash.iter().take(16).map(|b| format!("{b:02x}")).collect();
    format!("nelu3d-{hex}")
}
