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
    pub(super) fn write(&self, dir: &Path, r: &Surface, camera: &Camera) -> io::Result<()> {
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
pub(super) fn position(r: &Surface, camera: &Camera, i: usize) -> [f32; 3] {
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
fn texture_coordinates(r: &Surface, camera: &Camera) -> Vec<[f32; 2]> {
    let at = |v: &[f32; 3]| {
        // Pixel centers lie at integers, so that the picture begins at -0.5.
        let [x, y] = camera.project(&v.map(f64::from).into()).unwrap_or_default();
        [((x + 0.5) / r.width as f64) as f32, ((y + 0.5) / r.height as f64) as f32]
    };
    r.mesh.vertices.iter().map(at).collect()
}

/// Returns a name for the content: the same depth has the same.
fn guid(depth: &[f32]) -> String {
    let hash = Sha256::digest(bytemuck::cast_slice::<f32, u8>(depth));
    let hex: String = hash.iter().take(16).map(|b| format!("{b:02x}")).collect();
    format!("nelu3d-{hex}")
}

#[cfg(test)]
mod tests {
    use nelu3d_scan::camera::Distortion;
    use nelu3d_scan::{Image, Mesh};

    use super::*;
    use crate::surface::PixelStatus;

    /// A slanted plane before a camera with a distorting lens; every pixel is a vertex, and the last has no depth.
    fn plane() -> (Surface, Camera) {
        let (width, height) = (9, 7);
        let lens = Distortion::new(&[-0.1, 0.02, 1e-3, -1e-3, 0.0]).unwrap();
        let camera = Camera { distortion: lens, ..Camera::pinhole(width, height, 10.0, 11.0, 3.5, 2.5) };
        let n = width * height;
        let mut surface = Surface {
            width,
            height,
            depth: (0..n).map(|i| 500.0 + (i % width) as f32).collect(),
            normals: vec![[0.6, 0.0, -0.8]; n],
            sigma: vec![0.25; n],
            status: vec![PixelStatus::Valid; n],
            residual: vec![0.01; n],
            ambient: vec![0.5; n],
            white: Image { width, height, channels: 1, data: (0..n).map(|i| i as f32 / n as f32).collect() },
            mesh: Mesh::default(),
        };
        surface.depth[n - 1] = f32::NAN;
        let vertices: Vec<[f32; 3]> =
            (0..n).map(|i| position(&surface, &camera, i)).filter(|p| p[0].is_finite()).collect();
        surface.mesh = Mesh { vertices, faces: vec![[0, 9, 1], [1, 9, 10]], ..Mesh::default() };
        (surface, camera)
    }

    /// The picture's places are the pixels that the vertices come from, whatever the lens.
    #[test]
    fn vertices_lie_on_their_pixels() {
        let (surface, camera) = plane();
        for (i, [u, v]) in texture_coordinates(&surface, &camera).into_iter().enumerate() {
            let (x, y) = (u * 9.0 - 0.5, v * 7.0 - 0.5);
            assert!((x - (i % 9) as f32).abs() < 1e-3 && (y - (i / 9) as f32).abs() < 1e-3, "{i}: {x} {y}");
        }
    }

    /// Every name writes its file and no other, and maps are read back bit for bit.
    #[test]
    fn every_file_is_written_by_its_name() {
        let (surface, camera) = plane();
        for name in ExtraFiles::NAMES {
            let dir = tempfile::tempdir().unwrap();
            let mut files = ExtraFiles::default();
            assert!(files.add(name) && files != ExtraFiles::default());
            files.write(dir.path(), &surface, &camera).unwrap();
            let mut found: Vec<String> =
                std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
            found.sort();
            let expected: &[&str] = match name {
                "textured-obj" => &["textured.mtl", "textured.obj", "textured.png"],
                "textured-glb" => &["textured.glb"],
                "pcd" => &["points.pcd"],
                "e57" => &["points.e57"],
                "tiff" => &["depth.tiff"],
                "exr" => &["depth.exr"],
                _ => &[&format!("mesh.{name}")],
            };
            assert_eq!(found, expected, "{name}");
            if let "tiff" | "exr" = name {
                // What is not finite no image may hold: the reader of captures says so, and where.
                let raw = nelu3d_scan::image::decode(&dir.path().join(&found[0]), Some((9, 7))).unwrap();
                let nelu3d_scan::image::RawData::Float(data) = raw.data else { panic!("floats") };
                assert!(data.iter().zip(&surface.depth).all(|(a, b)| a.to_bits() == b.to_bits()), "{name}");
            }
        }
        assert!(!ExtraFiles::default().add("dwg"));
        assert_eq!(guid(&surface.depth), guid(&surface.depth.clone()));
    }
}
