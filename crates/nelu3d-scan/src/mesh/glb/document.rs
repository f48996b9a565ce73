//! The container of binary glTF and what of its document a mesh needs (Khronos, glTF 2.0 specification, §3 and §4.4).
//!
//! Materials, cameras, skins and animations are not read. Every reference and every length is checked before it is used:
//! a damaged file is an error, never a panic or an enormous allocation.

use std::collections::BTreeMap;

use nalgebra::{Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::{FLOAT, UNSIGNED_INT, UNSIGNED_SHORT};

/// glTF's code of `u8` components.
const UNSIGNED_BYTE: u32 = 5121;

/// The document of a file, as its JSON chunk says it. All numbers count from 0.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    /// The scene to show.
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<MeshEntry>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<BufferView>,
    #[serde(default)]
    buffers: Vec<Buffer>,
    #[serde(default)]
    extensions_required: Vec<String>,
}

/// The roots of a tree of nodes.
#[derive(Debug, Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

/// A placement of a mesh and of other nodes.
#[derive(Debug, Deserialize)]
pub(super) struct Node {
    /// Nodes that are placed relative to this one.
    #[serde(default)]
    pub children: Vec<usize>,
    mesh: Option<usize>,
    /// Column by column.
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    /// A unit quaternion x, y, z, w.
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

impl Node {
    /// The transform from this node's frame to its parent's.
    pub(super) fn transform(&self) -> Matrix4<f64> {
        if let Some(columns) = self.matrix {
            return Matrix4::from_column_slice(&columns);
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        Translation3::from(self.translation.unwrap_or_default()).to_homogeneous()
            * UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_homogeneous()
            * Matrix4::new_nonuniform_scaling(&Vector3::from(self.scale.unwrap_or([1.0; 3])))
    }
}

#[derive(Debug, Deserialize)]
struct MeshEntry {
    primitives: Vec<Primitive>,
}

/// Triangles, points or lines that share their vertices' attributes.
#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    /// Accessors by meaning, as `POSITION`.
    pub attributes: BTreeMap<String, usize>,
    /// The accessor of the corners' vertices; without one, all vertices in their order.
    pub indices: Option<usize>,
    /// What the corners form: 0 points, 1 to 3 lines, 4 triangles, 5 a strip of triangles, 6 a fan.
    #[serde(default = "triangles")]
    pub mode: u32,
}

fn triangles() -> u32 {
    4
}

/// An array in a buffer.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    shape: String,
    sparse: Option<IgnoredAny>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Debug, Deserialize)]
struct Buffer {
    uri: Option<IgnoredAny>,
}

/// The values of an array: bytes that lie in the file, every item `stride` after the one before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Values<'a> {
    bytes: &'a [u8],
    stride: usize,
    /// Number of items.
    pub count: usize,
    component: u32,
}

impl<'a> Values<'a> {
    /// Items of `N` bytes, from the beginning of each.
    fn chunks<const N: usize>(self) -> impl Iterator<Item = [u8; N]> + 'a {
        (0..self.count).map(move |i| self.bytes[i * self.stride..].first_chunk().copied().expect("checked before"))
    }

    /// Three floating-point numbers an item.
    pub(super) fn vectors(self) -> impl Iterator<Item = [f32; 3]> + 'a {
        self.chunks::<12>().map(|b| [0, 4, 8].map(|i| f32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]])))
    }

    /// Red, green and blue in [0, 1] of an item, whatever its type.
    pub(super) fn colors(self) -> Vec<[f32; 3]> {
        match self.component {
            UNSIGNED_BYTE => self.chunks::<3>().map(|c| c.map(|v| f32::from(v) / 255.0)).collect(),
            UNSIGNED_SHORT => {
                let color = |b: [u8; 6]| [0, 2, 4].map(|i| f32::from(u16::from_le_bytes([b[i], b[i + 1]])) / 65535.0);
                self.chunks::<6>().map(color).collect()
            }
            _ => self.vectors().collect(),
        }
    }

    /// One unsigned number an item.
    pub(super) fn indices(self) -> Vec<u32> {
        match self.component {
            UNSIGNED_BYTE => self.chunks::<1>().map(|b| b[0].into()).collect(),
            UNSIGNED_SHORT => self.chunks::<2>().map(|b| u16::from_le_bytes(b).into()).collect(),
            _ => self.chunks::<4>().map(u32::from_le_bytes).collect(),
        }
    }
}

/// Types of components, for [`Document::values`].
pub(super) const FLOATS: &[u32] = &[FLOAT];
/// Types that colors may have.
pub(super) const COLORS: &[u32] = &[FLOAT, UNSIGNED_BYTE, UNSIGNED_SHORT];
/// Types that indices may have.
pub(super) const INDICES: &[u32] = &[UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT];

impl Document {
    /// Splits a file into its document and its binary chunk, which is empty where there is none.
    pub(super) fn parse(bytes: &[u8]) -> Result<(Self, &[u8]), String> {
        let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
        if bytes.get(..4) != Some(b"glTF") {
            return Err("it does not start with `glTF`".into());
        }
        match word(4) {
            Some(2) => {}
            Some(version) => return Err(format!("it is of version {version}; version 2 can be read")),
            None => return Err("it ends in its header".into()),
        }
        let length = word(8).ok_or("it ends in its header")? as usize;
        let mut rest = bytes.get(12..length).ok_or("it is truncated: its header says another length")?;
        let mut chunk = |kind: &[u8; 4]| {
            let (header, after) = rest.split_first_chunk::<8>()?;
            let size = u32::from_le_bytes([header[0], header[1], header[2], header[3]]) as usize;
            let (content, after) = after.split_at_checked(size)?;
            rest = after;
            (&header[4..] == kind).then_some(content)
        };
        let text = chunk(b"JSON").ok_or("its first chunk is no whole document")?;
        let binary = chunk(b"BIN\0").unwrap_or_default();
        let document: Self = serde_json::from_slice(text).map_err(|e| e.to_string())?;
        match document.extensions_required.first() {
            Some(name) => Err(format!("it needs the extension {name}; export it without")),
            None => Ok((document, binary)),
        }
    }

    /// Number of nodes.
    pub(super) fn n_nodes(&self) -> usize {
        self.nodes.len()
    }

    /// The nodes that the scene to show begins with.
    pub(super) fn roots(&self) -> Result<&[usize], String> {
        let scene = self.scenes.get(self.scene.unwrap_or(0)).ok_or("it has no scene")?;
        Ok(&scene.nodes)
    }

    /// A node by its number.
    pub(super) fn node(&self, i: usize) -> Result<&Node, String> {
        self.nodes.get(i).ok_or_else(|| format!("it has no node {i}"))
    }

    /// What a node shows.
    pub(super) fn primitives(&self, node: &Node) -> Result<&[Primitive], String> {
        let Some(i) = node.mesh else { return Ok(&[]) };
        self.meshes.get(i).map(|m| &m.primitives[..]).ok_or_else(|| format!("it has no mesh {i}"))
    }

    /// An array by the number of its accessor, if it has one of these shapes and types and lies in the file.
    pub(super) fn values<'a>(
        &self,
        i: usize,
        binary: &'a [u8],
        shapes: &[&str],
        types: &[u32],
    ) -> Result<Values<'a>, String> {
        let Accessor { buffer_view, byte_offset, component_type, count, shape, sparse } =
            self.accessors.get(i).ok_or_else(|| format!("it has no accessor {i}"))?;
        if !shapes.contains(&shape.as_str()) || !types.contains(component_type) {
            return Err(format!("its accessor {i} is a {shape} of component type {component_type}"));
        }
        let view = match (buffer_view, sparse) {
            (Some(view), None) => {
                self.buffer_views.get(*view).ok_or_else(|| format!("it has no buffer view {view}"))?
            }
            _ => return Err(format!("its accessor {i} is sparse, which cannot be read")),
        };
        match self.buffers.get(view.buffer) {
            Some(buffer) if view.buffer == 0 && buffer.uri.is_none() => {}
            _ => return Err("its data lie outside the file".into()),
        }
        let n = match shape.as_str() {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let size = n * match *component_type {
            UNSIGNED_BYTE => 1,
            UNSIGNED_SHORT => 2,
            _ => 4,
        };
        let stride = view.byte_stride.unwrap_or(size);
        let bytes = view.byte_offset.checked_add(view.byte_length).and_then(|end| binary.get(view.byte_offset..end));
        let bytes = bytes.and_then(|b| b.get(*byte_offset..));
        let needed = match count.checked_sub(1) {
            Some(n) => n.checked_mul(stride).and_then(|n| n.checked_add(size)),
            None => Some(0),
        };
        match bytes.zip(needed) {
            Some((bytes, needed)) if stride >= size && needed <= bytes.len() => {
                Ok(Values { bytes, stride, count: *count, component: *component_type })
            }
            _ => Err(format!("its accessor {i} needs data that are not there")),
        }
    }
}
