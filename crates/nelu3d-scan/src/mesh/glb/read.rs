//! Reading binary glTF: all triangles and points of the scene that a viewer would show, in the camera's frame.

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use super::document::{COLORS, Document, FLOATS, INDICES, Primitive};
use crate::mesh::model::{Mesh, normalized, push_polygon};

pub(in super::super) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    let (document, binary) = Document::parse(bytes)?;
    let mut all = Mesh::default();
    let (mut all_normals, mut all_colors) = (true, true);
    let mut open: Vec<(usize, Matrix4<f64>)> = document.roots()?.iter().map(|&n| (n, Matrix4::identity())).collect();
    let mut visited = vec![false; document.n_nodes()];
    while let Some((i, above)) = open.pop() {
        let node = document.node(i)?;
        // glTF's nodes are trees; in a damaged file they may be a ring.
        if std::mem::replace(&mut visited[i], true) {
            return Err(format!("its node {i} hangs from two others"));
        }
        let transform = above * node.transform();
        // The other frames of an animation are scaled to nothing: a viewer shows none of it.
        if transform.fixed_view::<3, 3>(0, 0).iter().all(|&v| v == 0.0) {
            continue;
        }
        open.extend(node.children.iter().map(|&child| (child, transform)));
        for primitive in document.primitives(node)? {
            let Some(part) = read_primitive(&document, primitive, binary, &transform)? else { continue };
            let first = u32::try_from(all.vertices.len()).map_err(|_| "it has more than 4 billion vertices")?;
            all_normals &= !part.normals.is_empty();
            all_colors &= !part.colors.is_empty();
            all.vertices.extend(part.vertices);
            all.normals.extend(part.normals);
            all.colors.extend(part.colors);
            all.faces.extend(part.faces.iter().map(|f| f.map(|i| i.saturating_add(first))));
        }
    }
    if !all_normals {
        all.normals.clear();
    }
    if !all_colors {
        all.colors.clear();
    }
    Ok(all)
}

/// A primitive's triangles or points in the camera's frame; `None` for lines and what has no positions.
fn read_primitive(
    document: &Document,
    primitive: &Primitive,
    binary: &[u8],
    transform: &Matrix4<f64>,
) -> Result<Option<Mesh>, String> {
    let Some(&positions) = primitive.attributes.get("POSITION") else { return Ok(None) };
    let positions = document.values(positions, binary, &["VEC3"], FLOATS)?;
    let attribute = |name: &str, shapes: &[&str], types: &[u32]| {
        let Some(&accessor) = primitive.attributes.get(name) else { return Ok(None) };
        let values = document.values(accessor, binary, shapes, types)?;
        let complete = values.count == positions.count;
        if complete { Ok(Some(values)) } else { Err("an attribute has not one value per vertex".to_owned()) }
    };
    let normals = attribute("NORMAL", &["VEC3"], FLOATS)?;
    let colors = attribute("COLOR_0", &["VEC3", "VEC4"], COLORS)?;

    let mut mesh = Mesh::default();
    // Meters and y up back to millimeters and y down.
    let camera = |p: Vector3<f64>| [p.x as f32, -p.y as f32, -p.z as f32];
    for p in positions.vectors() {
        let p = transform.transform_point(&Point3::from(p.map(f64::from)));
        mesh.vertices.push(camera(p.coords * 1000.0));
    }
    let linear: Matrix3<f64> = transform.fixed_view::<3, 3>(0, 0).into_owned();
    let mirrored = linear.determinant() < 0.0;
    if let Some(normals) = normals {
        // Normals go by the inverse's transpose; its direction is that of the cofactors, which always exist.
        let columns = [0, 1, 2].map(|i| linear.column(i).into_owned());
        let cofactors = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| columns[i].cross(&columns[j]));
        let normal = Matrix3::from_columns(&cofactors) * if mirrored { -1.0 } else { 1.0 };
        for n in normals.vectors() {
            let n = camera(normal * Vector3::from(n.map(f64::from)));
            mesh.normals.push(normalized(n.map(f64::from)));
        }
    }
    if let Some(colors) = colors {
        mesh.colors.extend(colors.colors().into_iter().map(|c| c.map(srgb_u8)));
    }
    let corners = match primitive.indices {
        Some(indices) => document.values(indices, binary, &["SCALAR"], INDICES)?.indices(),
        None => (0..mesh.vertices.len() as u32).collect(),
    };
    match primitive.mode {
        0 => {}
        4 => mesh.faces = corners.as_chunks().0.to_vec(),
        5 => {
            let triangle = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            mesh.faces = corners.windows(3).enumerate().map(triangle).collect();
        }
        6 => push_polygon(&mut mesh.faces, &corners),
        1..=3 => return Ok(None),
        mode => return Err(format!("it has a primitive of the unknown mode {mode}")),
    }
    if mirrored {
        mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    Ok(Some(mesh))
}

/// Linear light to an 8-bit sRGB value (IEC 61966-2-1): the inverse of what the writer does.
fn srgb_u8(linear: f32) -> u8 {
    let c = f64::from(linear);
    let s = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round().clamp(0.0, 255.0) as u8
}
