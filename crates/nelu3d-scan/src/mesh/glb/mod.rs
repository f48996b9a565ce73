//! Binary glTF 2.0, for viewers: one mesh (or point cloud) in one file, or several, shown one after the other.
//!
//! glTF demands meters and y up, so that a viewer shows the scan as the camera saw it: (x, y, z) mm of the camera's
//! frame becomes (x, −y, −z) / 1000. That is half a turn about x, so triangles keep their winding.

mod animated;
mod document;
mod read;

pub use animated::AnimatedGlb;
pub(super) use read::parse;

use std::io::{self, Write};

use serde_json::{Value, json};

use super::model::Mesh;

/// glTF's code of `f32` components.
const FLOAT: u32 = 5126;
/// glTF's code of `u16` components.
const UNSIGNED_SHORT: u32 = 5123;
/// glTF's code of `u32` components.
const UNSIGNED_INT: u32 = 5125;

/// The binary part of the file and what describes it.
#[derive(Debug, Default)]
struct Buffers {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffers {
    /// Appends an array of `count` items and returns the number of its accessor, which gets these extra keys.
    fn push(&mut self, bytes: Vec<u8>, count: usize, component: u32, shape: &str, extra: Value) -> usize {
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        // Arrays begin at multiples of four bytes, whatever came before.
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut accessor =
            json!({"bufferView": self.views.len(), "componentType": component, "count": count, "type": shape});
        if let Value::Object(extra) = extra {
            for (key, value) in extra {
                accessor[key] = value;
            }
        }
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

pub(super) fn write(mesh: &Mesh, w: &mut dyn Write) -> io::Result<()> {
    let mut buffers = Buffers::default();
    let mut scene = json!({
        "asset": {"version": "2.0", "generator": "nelu3d"},
        "scene": 0,
        "scenes": [{"nodes": []}],
    });
    // glTF allows neither empty arrays nor empty meshes: an empty mesh is an empty scene.
    if !mesh.vertices.is_empty() {
        let primitive = push_mesh(mesh, &mut buffers);
        scene["scenes"][0]["nodes"] = json!([0]);
        scene["nodes"] = json!([{"mesh": 0}]);
        scene["meshes"] = json!([{"primitives": [primitive]}]);
    }
    write_file(scene, buffers, w)
}

/// Writes a mesh with a picture, a PNG file, on it. `uv` is where in the picture each vertex is, from its upper left
/// corner.
pub(super) fn write_textured(mesh: &Mesh, uv: &[[f32; 2]], png: &[u8], w: &mut dyn Write) -> io::Result<()> {
    if mesh.vertices.is_empty() {
        return write(mesh, w);
    }
    let mut buffers = Buffers::default();
    // The picture has the colors.
    let bare = Mesh { colors: Vec::new(), ..mesh.clone() };
    let mut primitive = push_mesh(&bare, &mut buffers);
    let bytes = uv.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    primitive["attributes"]["TEXCOORD_0"] = json!(buffers.push(bytes, uv.len(), FLOAT, "VEC2", Value::Null));
    let view = json!({"buffer": 0, "byteOffset": buffers.bytes.len(), "byteLength": png.len()});
    buffers.bytes.extend(png);
    buffers.bytes.resize(buffers.bytes.len().next_multiple_of(4), 0);
    buffers.views.push(view);
    let scene = json!({
        "asset": {"version": "2.0", "generator": "nelu3d"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "images": [{"bufferView": buffers.views.len() - 1, "mimeType": "image/png"}],
        // Nothing beyond the picture's edge is ever looked up.
        "samplers": [{"wrapS": 33071, "wrapT": 33071}],
        "textures": [{"source": 0, "sampler": 0}],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 0.9},
        }],
    });
    write_file(scene, buffers, w)
}

/// Writes a scene and what it refers to as one file.
fn write_file(mut scene: Value, buffers: Buffers, w: &mut dyn Write) -> io::Result<()> {
    if !buffers.bytes.is_empty() {
        if scene["materials"].is_null() {
            scene["materials"] = json!([{
                "doubleSided": true,
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9},
            }]);
        }
        scene["buffers"] = json!([{"byteLength": buffers.bytes.len()}]);
        scene["bufferViews"] = Value::Array(buffers.views);
        scene["accessors"] = Value::Array(buffers.accessors);
    }
    let mut text = serde_json::to_vec(&scene)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let binary = if buffers.bytes.is_empty() { 0 } else { 8 + buffers.bytes.len() };
    let total = u32::try_from(12 + 8 + text.len() + binary)
        .map_err(|_| io::Error::other("too large for .glb (4 GiB); write .ply instead"))?;
    w.write_all(b"glTF")?;
    w.write_all(&2u32.to_le_bytes())?;
    w.write_all(&total.to_le_bytes())?;
    // `total` fits, so its parts do.
    w.write_all(&(text.len() as u32).to_le_bytes())?;
    w.write_all(b"JSON")?;
    w.write_all(&text)?;
    if binary > 0 {
        w.write_all(&(buffers.bytes.len() as u32).to_le_bytes())?;
        w.write_all(b"BIN\0")?;
        w.write_all(&buffers.bytes)?;
    }
    Ok(())
}

/// Appends the mesh's arrays and returns its glTF primitive.
fn push_mesh(mesh: &Mesh, buffers: &mut Buffers) -> Value {
    let n = mesh.vertices.len();
    let floats = |v: &[[f32; 3]]| v.iter().flatten().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();

    let positions: Vec<[f32; 3]> =
        mesh.vertices.iter().map(|&[x, y, z]| [x / 1000.0, -y / 1000.0, -z / 1000.0]).collect();
    let (mut min, mut max) = (positions[0], positions[0]);
    for p in &positions {
        for i in 0..3 {
            min[i] = min[i].min(p[i]);
            max[i] = max[i].max(p[i]);
        }
    }
    let bounds = json!({"min": min, "max": max});
    let mut attributes = json!({"POSITION": buffers.push(floats(&positions), n, FLOAT, "VEC3", bounds)});

    let computed;
    let normals = if mesh.normals.is_empty() && !mesh.faces.is_empty() {
        let mut with_normals = mesh.clone();
        with_normals.compute_normals();
        computed = with_normals.normals;
        &computed
    } else {
        &mesh.normals
    };
    if !normals.is_empty() {
        // glTF's normals are unit vectors: where there is none, the viewer's direction.
        let normals: Vec<[f32; 3]> = normals
            .iter()
            .map(|&[x, y, z]| if [x, y, z] == [0.0; 3] { [0.0, 0.0, 1.0] } else { [x, -y, -z] })
            .collect();
        attributes["NORMAL"] = json!(buffers.push(floats(&normals), n, FLOAT, "VEC3", Value::Null));
    }
    if !mesh.colors.is_empty() {
        let colors = mesh.colors.iter().flat_map(|&[r, g, b]| [linear_u16(r), linear_u16(g), linear_u16(b), u16::MAX]);
        let bytes = colors.flat_map(u16::to_le_bytes).collect();
        attributes["COLOR_0"] = json!(buffers.push(bytes, n, UNSIGNED_SHORT, "VEC4", json!({"normalized": true})));
    }
    let mut primitive = json!({"attributes": attributes, "material": 0});
    if mesh.faces.is_empty() {
        primitive["mode"] = json!(0); // points
    } else {
        let corners = mesh.faces.iter().flatten();
        // 65535 would mean "begin anew".
        let (bytes, component) = if n <= 65535 {
            (corners.flat_map(|&i| (i as u16).to_le_bytes()).collect::<Vec<u8>>(), UNSIGNED_SHORT)
        } else {
            (corners.flat_map(|i| i.to_le_bytes()).collect(), UNSIGNED_INT)
        };
        primitive["indices"] = json!(buffers.push(bytes, 3 * mesh.faces.len(), component, "SCALAR", Value::Null));
    }
    primitive
}

/// Converts an 8-bit sRGB value, as pictures have, to the linear light glTF wants (IEC 61966-2-1), 16 bits.
fn linear_u16(c: u8) -> u16 {
    let c = f64::from(c) / 255.0;
    let linear = if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
    (linear * 65535.0).round() as u16
}
