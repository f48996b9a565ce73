//! Triangle meshes and point clouds, and their files.
//!
//! | format | read | written | lengths and axes |
//! |---|---|---|---|
//! | `.ply` | ASCII, binary | binary | mm, camera frame (x right, y down, z forward) |
//! | `.obj` | yes | yes, with vertex colors | mm, camera frame |
//! | `.stl` | ASCII, binary | binary, no colors | mm, camera frame |
//! | `.glb` | yes | yes | **meters, y up**: (x, −y, −z) / 1000, as glTF 2.0 demands |
//!
//! [`AnimatedGlb`] writes a sequence of meshes as one `.glb`.

mod glb;
mod obj;
mod ply;
mod stl;

use std::io;
use std::path::{Path, PathBuf};

pub use glb::AnimatedGlb;

use crate::output::write_atomic;

/// A triangle mesh in the camera's frame, mm. Without faces it is a point cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, mm.
    pub vertices: Vec<[f32; 3]>,
    /// Unit vertex normals; empty or one per vertex.
    pub normals: Vec<[f32; 3]>,
    /// Vertex colors; empty or one per vertex.
    pub colors: Vec<[u8; 3]>,
    /// Triangles, counter-clockwise seen from outside (from the camera's side).
    pub faces: Vec<[u32; 3]>,
}

/// Why a mesh file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file is missing, or the operating system would not let it be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Truncated or damaged, or of a kind that is no triangle mesh.
    #[error("{}: cannot be used as a mesh: {reason}; export it again as a triangle mesh", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A file name whose ending says no known format.
    #[error("{}: is of no mesh format that can be read; give a .ply, .obj, .stl or .glb file", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
}

impl Mesh {
    /// Reads a mesh; the format is told by the name's ending (`.ply`, `.obj`, `.stl`, `.glb`). Polygons are cut into triangles.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is damaged, has a face without its vertices, or is of another format.
    pub fn read(path: &Path) -> Result<Self, MeshFileError> {
        let parse = match extension(path).as_str() {
            "ply" => ply::parse,
            "obj" => obj::parse,
            "stl" => stl::parse,
            "glb" => glb::parse,
            _ => return Err(MeshFileError::Format { path: path.into() }),
        };
        let bytes = std::fs::read(path).map_err(|source| MeshFileError::Io { path: path.to_path_buf(), source })?;
        let damaged = |reason| MeshFileError::Damaged { path: path.to_path_buf(), reason };
        let mut mesh = parse(&bytes).map_err(damaged)?;
        if let Some(face) = mesh.faces.iter().find(|f| f.iter().any(|&i| i as usize >= mesh.vertices.len())) {
            return Err(damaged(format!("the face {face:?} needs a vertex that {} do not have", mesh.vertices.len())));
        }
        if let Some(i) = mesh.vertices.iter().position(|v| v.iter().any(|c| !c.is_finite())) {
            return Err(damaged(format!("vertex {i} is at {:?}", mesh.vertices[i])));
        }
        for n in &mut mesh.normals {
            *n = normalized(n.map(f64::from));
        }
        Ok(mesh)
    }

    /// [`write()`] as a method.
    ///
    /// # Errors
    ///
    /// As [`write()`].
    pub fn write(&self, path: &Path) -> io::Result<()> {
        write(path, self)
    }

    /// Sets the vertex normals: the mean of the adjacent triangles' normals, weighted by area. A vertex without a
    /// triangle gets (0, 0, 0).
    pub fn compute_normals(&mut self) {
        let mut sums = vec![[0.0f64; 3]; self.vertices.len()];
        for face in &self.faces {
            // The cross product's length is twice the triangle's area: the weight comes for free.
            let n = self.face_cross(*face);
            for &i in face {
                for (sum, c) in sums[i as usize].iter_mut().zip(n) {
                    *sum += c;
                }
            }
        }
        self.normals = sums.into_iter().map(normalized).collect();
    }

    /// Panics where [`write()`] says so.
    fn assert_whole(&self) {
        let n = self.vertices.len();
        assert!(self.normals.is_empty() || self.normals.len() == n, "one normal per vertex");
        assert!(self.colors.is_empty() || self.colors.len() == n, "one color per vertex");
        assert!(self.faces.iter().flatten().all(|&i| (i as usize) < n), "a face of existing vertices");
    }

    /// (b − a) × (c − a) of a triangle: its outward normal times twice its area, mm².
    fn face_cross(&self, [a, b, c]: [u32; 3]) -> [f64; 3] {
        let [a, b, c] = [a, b, c].map(|i| self.vertices[i as usize].map(f64::from));
        let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    }
}

/// Writes a mesh in the format of the name's ending (`.ply`, `.obj`, `.stl`, `.glb`; see the module). Normals and colors
/// are written where there are any and the format has them; `.glb` computes missing normals.
///
/// # Errors
///
/// The name has another ending, or the file cannot be written; the message names the file.
///
/// # Panics
///
/// If there are some normals or colors but not one per vertex, or a face has a vertex that does not exist.
pub fn write(path: &Path, mesh: &Mesh) -> io::Result<()> {
    mesh.assert_whole();
    let write = match extension(path).as_str() {
        "ply" => ply::write,
        "obj" => obj::write,
        "stl" => stl::write,
        "glb" => glb::write,
        _ => {
            let problem = format!("{}: is of no known mesh format; name it .ply, .obj, .stl or .glb", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
    };
    write_atomic(path, |w| write(mesh, w))
}

/// Writes a point cloud as binary PLY (mm, camera frame). `normals` and `colors` are empty or one per point.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If there are some normals or colors but not one per point.
pub fn write_points(path: &Path, positions: &[[f32; 3]], normals: &[[f32; 3]], colors: &[[u8; 3]]) -> io::Result<()> {
    assert!(normals.is_empty() || normals.len() == positions.len(), "one normal per point");
    assert!(colors.is_empty() || colors.len() == positions.len(), "one color per point");
    write_atomic(path, |w| ply::write_parts(positions, normals, colors, &[], w))
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// A unit vector, or zero where there is no direction.
fn normalized(v: [f64; 3]) -> [f32; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { v.map(|c| (c / length) as f32) } else { [0.0; 3] }
}

/// Cuts a polygon into a fan of triangles.
fn push_polygon(faces: &mut Vec<[u32; 3]>, corners: &[u32]) {
    for i in 2..corners.len() {
        faces.push([corners[0], corners[i - 1], corners[i]]);
    }
}

#[cfg(test)]
mod tests;
