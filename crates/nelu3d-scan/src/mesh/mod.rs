//! Triangle meshes and point clouds, and their files.
//!
//! | format | read | written | lengths and axes |
//! |---|---|---|---|
//! | `.ply` | ASCII, binary | binary | mm, camera frame (x right, y down, z forward) |
//! | `.obj` | yes | yes, with vertex colors | mm, camera frame |
//! | `.stl` | ASCII, binary | binary, no colors | mm, camera frame |
//! | `.glb` | yes | yes | **meters, y up**: (x, −y, −z) / 1000, as glTF 2.0 demands |
//! | `.3mf` | no | yes, without normals and colors | mm, as the file states; camera frame |
//!
//! [`AnimatedGlb`] writes a sequence of meshes as one `.glb`, [`TexturedMesh`] a mesh with a picture on it.

mod error;
mod glb;
mod model;
mod obj;
mod ply;
mod stl;
mod textured;
mod threemf;

use std::io;
use std::path::Path;

pub use error::MeshFileError;
pub use glb::AnimatedGlb;
pub use model::Mesh;
pub use textured::{TexturedMesh, write_textured_glb, write_textured_obj};

use self::model::normalized;
use crate::input::{MAX_DATA, read_file, shortened};
use crate::output::write_atomic;

/// Reads one format; fails with what is wrong.
type Parser = fn(&[u8]) -> Result<Mesh, String>;

fn parser(path: &Path) -> Result<Parser, MeshFileError> {
    match extension(path).as_str() {
        "ply" => Ok(ply::parse),
        "obj" => Ok(obj::parse),
        "stl" => Ok(stl::parse),
        "glb" => Ok(glb::parse),
        _ => Err(MeshFileError::Format { path: path.into() }),
    }
}

impl Mesh {
    /// Reads a mesh; the format is told by the name's ending (`.ply`, `.obj`, `.stl`, `.glb`). Polygons are cut into
    /// triangles.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is damaged, has a face without its vertices, or is of another format.
    pub fn read(path: &Path) -> Result<Self, MeshFileError> {
        let parse = parser(path)?;
        let bytes =
            read_file(path, MAX_DATA).map_err(|source| MeshFileError::Io { path: path.to_path_buf(), source })?;
        Self::parse(path, &bytes, parse)
    }

    /// Reads a mesh from the content of a file, as [`Mesh::read`] does; `path` tells the format and is named in
    /// messages.
    ///
    /// # Errors
    ///
    /// As [`Mesh::read`], but for what concerns the file itself.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Self, MeshFileError> {
        Self::parse(path, bytes, parser(path)?)
    }

    fn parse(path: &Path, bytes: &[u8], parse: Parser) -> Result<Self, MeshFileError> {
        let damaged = |reason: String| MeshFileError::Damaged { path: path.to_path_buf(), reason: shortened(&reason) };
        let mut mesh = parse(bytes).map_err(damaged)?;
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

    /// Writes the mesh as [`write()`] does.
    ///
    /// # Errors
    ///
    /// As [`write()`].
    pub fn write(&self, path: &Path) -> io::Result<()> {
        write(path, self)
    }
}

/// Writes a mesh in the format of the name's ending (`.ply`, `.obj`, `.stl`, `.glb`, `.3mf`; see the module). Normals and
/// colors are written where there are any and the format has them; `.glb` computes missing normals.
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
        "3mf" => threemf::write,
        _ => {
            let problem =
                format!("{}: is of no known mesh format; name it .ply, .obj, .stl, .glb, or .3mf", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
    };
    write_atomic(path, |w| write(mesh, w))
}

/// Writes a point cloud as binary PLY (mm, camera frame). `normals`, `colors`, and `sigma` (one standard deviation, mm)
/// are empty or one per point.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If there are some normals, colors, or deviations, but not one per point.
pub fn write_points(
    path: &Path,
    positions: &[[f32; 3]],
    normals: &[[f32; 3]],
    colors: &[[u8; 3]],
    sigma: &[f32],
) -> io::Result<()> {
    assert!(normals.is_empty() || normals.len() == positions.len(), "one normal per point");
    assert!(colors.is_empty() || colors.len() == positions.len(), "one color per point");
    assert!(sigma.is_empty() || sigma.len() == positions.len(), "one deviation per point");
    write_atomic(path, |w| ply::write_parts(positions, normals, colors, sigma, &[], w))
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}
