//! Wavefront OBJ with a picture: `vt` counts from the lower edge.

use std::io::{self, Write};

use super::model::TexturedMesh;

/// Writes the mesh; its material is `stem.mtl`.
pub(super) fn write(textured: &TexturedMesh<'_>, stem: &str, w: &mut dyn Write) -> io::Result<()> {
    let mesh = textured.mesh;
    writeln!(w, "# nelu3d: mm, camera frame (x right, y down, z forward)\nmtllib {stem}.mtl")?;
    for [x, y, z] in &mesh.vertices {
        writeln!(w, "v {x} {y} {z}")?;
    }
    for [u, v] in textured.uv {
        writeln!(w, "vt {u} {}", 1.0 - v)?;
    }
    for [x, y, z] in &mesh.normals {
        writeln!(w, "vn {x} {y} {z}")?;
    }
    writeln!(w, "usemtl flash")?;
    for face in &mesh.faces {
        let [a, b, c] = face.map(|i| u64::from(i) + 1);
        if mesh.normals.is_empty() {
            writeln!(w, "f {a}/{a} {b}/{b} {c}/{c}")?;
        } else {
            writeln!(w, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}")?;
        }
    }
    Ok(())
}

/// Writes the material: the picture as the surface's own color, without shine.
pub(super) fn write_material(stem: &str, w: &mut dyn Write) -> io::Result<()> {
    writeln!(w, "newmtl flash\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {stem}.png")
}
