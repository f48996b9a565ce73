//! STL: triangles alone. Equal corners become one vertex when read.

use std::io::{self, Cursor, Write};

use stl_io::{Normal, Triangle, Vertex};

use super::model::{Mesh, normalized};

pub(super) fn write(mesh: &Mesh, mut w: &mut dyn Write) -> io::Result<()> {
    let triangles = mesh.faces.iter().map(|&face| Triangle {
        normal: Normal::new(normalized(mesh.face_cross(face))),
        vertices: face.map(|i| Vertex::new(mesh.vertices[i as usize])),
    });
    stl_io::write_stl(&mut w, triangles)
}

pub(super) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    let mut bytes = bytes.to_vec();
    // Many binary files start with `solid`, as ASCII ones do: the length, which follows from the count, decides.
    let count = bytes.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    if count.is_some_and(|n| bytes.len() == 84 + 50 * n) {
        bytes[..5].fill(0);
    }
    let stl = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let index = |i: usize| u32::try_from(i).map_err(|_| "it has more than 4 billion vertices".to_owned());
    let mut faces = Vec::with_capacity(stl.faces.len());
    for f in &stl.faces {
        let [a, b, c] = f.vertices;
        faces.push([index(a)?, index(b)?, index(c)?]);
    }
    Ok(Mesh { vertices: stl.vertices.iter().map(|v| v.0).collect(), faces, ..Mesh::default() })
}
