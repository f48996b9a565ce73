//! Reading binary glTF: all triangles and points of the scene that a viewer would show, in the camera's frame.

use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Glb, Node, Primitive, Semantic};
use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use crate::mesh::model::{Mesh, normalized, push_polygon};

pub(in crate::mesh) fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    // The library subtracts the header's length from the file's as it is declared there.
    if bytes.get(8..12).is_none_or(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) < 12) {
        return Err("it ends in its header".into());
    }
    let glb = Glb::from_slice(bytes).map_err(|e| e.to_string())?;
    let root = gltf::json::Root::from_slice(&glb.json).map_err(|e| e.to_string())?;
    // The library's own check of positions' bounds looks them up before it knows that they exist.
    let primitives = || root.meshes.iter().flat_map(|m| &m.primitives);
    if primitives().flat_map(|p| p.attributes.values()).any(|i| i.value() >= root.accessors.len()) {
        return Err("it has an attribute without an accessor".into());
    }
    let document = Document::from_json(root).map_err(|e| e.to_string())?;
    let blob = glb.bin.unwrap_or_default();
    let scene = document.default_scene().or_else(|| document.scenes().next()).ok_or("it has no scene")?;
    let mut all = Mesh::default();
    let (mut all_normals, mut all_colors) = (true, true);
    let mut open: Vec<(Node, Matrix4<f64>)> = scene.nodes().map(|n| (n, Matrix4::identity())).collect();
    let mut visited = vec![false; document.nodes().count()];
    while let Some((node, above)) = open.pop() {
        // glTF's nodes are trees; in a damaged file they may be a ring.
        if std::mem::replace(&mut visited[node.index()], true) {
            return Err(format!("its node {} hangs from two others", node.index()));
        }
        let local = Matrix4::from(node.transform().matrix()).map(f64::from);
        let transform = above * local;
        // The other frames of an animation are scaled to nothing: a viewer shows none of it.
        if transform.fixed_view::<3, 3>(0, 0).iter().all(|&v| v == 0.0) {
            continue;
        }
        open.extend(node.children().map(|child| (child, transform)));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            let Some(part) = read_primitive(&primitive, &blob, &transform)? else { continue };
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

/// Reads a primitive's triangles or points in the camera's frame; `None` for lines and what has no positions.
fn read_primitive(primitive: &Primitive, blob: &[u8], transform: &Matrix4<f64>) -> Result<Option<Mesh>, String> {
    let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(None) };
    check(&positions, blob, Dimensions::Vec3, &[DataType::F32])?;
    let count = positions.count();
    let attribute = |semantic: &Semantic, shapes: &[Dimensions], types: &[DataType]| {
        let Some(accessor) = primitive.get(semantic) else { return Ok(false) };
        let shape = shapes.iter().copied().find(|s| *s == accessor.dimensions()).unwrap_or(shapes[0]);
        check(&accessor, blob, shape, types)?;
        if accessor.count() == count { Ok(true) } else { Err("an attribute has not one value per vertex".to_owned()) }
    };
    let has_normals = attribute(&Semantic::Normals, &[Dimensions::Vec3], &[DataType::F32])?;
    let color_types = [DataType::F32, DataType::U8, DataType::U16];
    let has_colors = attribute(&Semantic::Colors(0), &[Dimensions::Vec3, Dimensions::Vec4], &color_types)?;
    if let Some(indices) = primitive.indices() {
        check(&indices, blob, Dimensions::Scalar, &[DataType::U8, DataType::U16, DataType::U32])?;
    }

    let reader = primitive.reader(|_| Some(blob));
    let mut mesh = Mesh::default();
    // Meters and y up back to millimeters and y down.
    let camera = |p: Vector3<f64>| [p.x as f32, -p.y as f32, -p.z as f32];
    for p in reader.read_positions().ok_or("its positions cannot be read")? {
        let p = transform.transform_point(&Point3::from(p.map(f64::from)));
        mesh.vertices.push(camera(p.coords * 1000.0));
    }
    let linear: Matrix3<f64> = transform.fixed_view::<3, 3>(0, 0).into_owned();
    let mirrored = linear.determinant() < 0.0;
    if has_normals {
        // Normals go by the inverse's transpose; its direction is that of the cofactors, which always exist.
        let columns = [0, 1, 2].map(|i| linear.column(i).into_owned());
        let cofactors = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| columns[i].cross(&columns[j]));
        let normal = Matrix3::from_columns(&cofactors) * if mirrored { -1.0 } else { 1.0 };
        for n in reader.read_normals().ok_or("its normals cannot be read")? {
            let n = camera(normal * Vector3::from(n.map(f64::from)));
            mesh.normals.push(normalized(n.map(f64::from)));
        }
    }
    if has_colors {
        let colors = reader.read_colors(0).ok_or("its colors cannot be read")?;
        mesh.colors.extend(colors.into_rgb_f32().map(|c| c.map(srgb_u8)));
    }
    let corners: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..mesh.vertices.len() as u32).collect(),
    };
    match primitive.mode() {
        Mode::Points => {}
        Mode::Triangles => mesh.faces = corners.as_chunks().0.to_vec(),
        Mode::TriangleStrip => {
            let triangle = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            mesh.faces = corners.windows(3).enumerate().map(triangle).collect();
        }
        Mode::TriangleFan => push_polygon(&mut mesh.faces, &corners),
        Mode::Lines | Mode::LineLoop | Mode::LineStrip => return Ok(None),
    }
    if mirrored {
        mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    Ok(Some(mesh))
}

/// Checks that an accessor's data are of a kind that can be read and lie in the file: the library's readers trust that.
fn check(accessor: &Accessor, blob: &[u8], shape: Dimensions, types: &[DataType]) -> Result<(), String> {
    if accessor.dimensions() != shape || !types.contains(&accessor.data_type()) {
        let (dimensions, data) = (accessor.dimensions(), accessor.data_type());
        return Err(format!("its accessor {} is a {dimensions:?} of {data:?}", accessor.index()));
    }
    let view = match (accessor.view(), accessor.sparse()) {
        (Some(view), None) => view,
        _ => return Err(format!("its accessor {} is sparse, which cannot be read", accessor.index())),
    };
    if !matches!(view.buffer().source(), gltf::buffer::Source::Bin) {
        return Err("its data lie outside the file".into());
    }
    let size = accessor.size();
    let stride = view.stride().unwrap_or(size);
    let needed = (accessor.count().checked_sub(1))
        .and_then(|n| n.checked_mul(stride)?.checked_add(size)?.checked_add(accessor.offset()));
    let end = view.offset().checked_add(view.length());
    let fits = stride >= size && needed.is_some_and(|n| n <= view.length()) && end.is_some_and(|end| end <= blob.len());
    if fits { Ok(()) } else { Err(format!("its accessor {} needs data that are not there", accessor.index())) }
}

/// Converts linear light to an 8-bit sRGB value (IEC 61966-2-1): the inverse of what the writer does.
fn srgb_u8(linear: f32) -> u8 {
    let c = f64::from(linear);
    let s = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round().clamp(0.0, 255.0) as u8
}
