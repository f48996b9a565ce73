//! Wavefront OBJ; vertex colors follow the position, as most tools write them.

use std::collections::HashMap;
use std::io::{self, Write};

use super::model::Mesh;

pub(super) fn write(mesh: &Mesh, w: &mut dyn Write) -> io::Result<()> {
    writeln!(w, "# nelu3d: mm, camera frame (x right, y down, z forward)")?;
    for (i, [x, y, z]) in mesh.vertices.iter().enumerate() {
        match mesh.colors.get(i) {
            Some(color) => {
                let [r, g, b] = color.map(|c| f32::from(c) / 255.0);
                writeln!(w, "v {x} {y} {z} {r} {g} {b}")?;
            }
            None => writeln!(w, "v {x} {y} {z}")?,
        }
    }
    for [x, y, z] in &mesh.normals {
        writeln!(w, "vn {x} {y} {z}")?;
    }
    for face in &mesh.faces {
        let [a, b, c] = face.map(|i| u64::from(i) + 1);
        if mesh.normals.is_empty() {
            writeln!(w, "f {a} {b} {c}")?;
        } else {
            writeln!(w, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
    }
    Ok(())
}

pub(super) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ..Default::default() };
    // Materials lie in other files and say nothing about the shape.
    let no_materials = |_: &std::path::Path| Ok((Vec::new(), HashMap::default()));
    let (models, _) = tobj::load_obj_buf(&mut &bytes[..], &options, no_materials).map_err(|e| e.to_string())?;
    let triples = |v: &[f32]| v.as_chunks().0.to_vec();
    let mut mesh = Mesh::default();
    let (mut all_normals, mut all_colors) = (true, true);
    for tobj::Model { mesh: part, .. } in models {
        let first = u32::try_from(mesh.vertices.len()).map_err(|_| "it has more than 4 billion vertices")?;
        let n = part.positions.len() / 3;
        mesh.vertices.extend(triples(&part.positions));
        all_normals &= part.normals.len() == 3 * n;
        all_colors &= part.vertex_color.len() == 3 * n;
        if all_normals {
            mesh.normals.extend(triples(&part.normals));
        }
        if all_colors {
            let byte = |c: f32| (c * 255.0).round().clamp(0.0, 255.0) as u8;
            mesh.colors.extend(triples(&part.vertex_color).into_iter().map(|c| c.map(byte)));
        }
        for &[a, b, c] in part.indices.as_chunks().0 {
            mesh.faces.push([a, b, c].map(|i| i.saturating_add(first)));
        }
    }
    if !all_normals {
        mesh.normals.clear();
    }
    if !all_colors {
        mesh.colors.clear();
    }
    if mesh.vertices.is_empty() {
        return Err("it has no faces".into());
    }
    Ok(mesh)
}
