//! A mesh with a picture on it: what the camera saw, at its full resolution, where vertices have one color each.

mod model;
mod obj;

use std::io;
use std::path::Path;

pub use model::TexturedMesh;

use super::glb;
use crate::output::write_atomic;

/// Writes one .glb file with the picture inside (meters, y up, as every .glb).
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If there is not one place in the picture per vertex.
pub fn write_textured_glb(path: &Path, textured: &TexturedMesh<'_>) -> io::Result<()> {
    textured.assert_whole();
    write_atomic(path, |w| glb::write_textured(textured.mesh, textured.uv, textured.png, w))
}

/// Writes an .obj file (mm, camera frame) with an .mtl and a .png file of the same name beside it.
///
/// # Errors
///
/// A file cannot be written, or the name is no text.
///
/// # Panics
///
/// If there is not one place in the picture per vertex.
pub fn write_textured_obj(path: &Path, textured: &TexturedMesh<'_>) -> io::Result<()> {
    textured.assert_whole();
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    let stem = stem.ok_or_else(|| io::Error::other(format!("{}: is no name for a file", path.display())))?;
    write_atomic(&path.with_extension("png"), |w| w.write_all(textured.png))?;
    write_atomic(&path.with_extension("mtl"), |w| obj::write_material(stem, w))?;
    write_atomic(path, |w| obj::write(textured, stem, w))
}
