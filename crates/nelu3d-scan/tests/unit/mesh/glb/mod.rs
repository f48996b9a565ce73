//! What other programs write: layouts, types and primitives that our own files do not have, and broken references.

mod animated;

use std::path::Path;

use nelu3d_scan::Mesh;
use serde_json::{Value, json};

/// A quad and a lonely vertex in one interleaved view, positions and normals; then indices as `u8`, colors as `u8` and
/// `f32`.
fn document() -> (Value, Vec<u8>) {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [3.0, 3.0, 3.0]];
    let vertex = |p: &[f32; 3]| p.iter().chain(&[0.0, 0.0, 1.0]).flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();
    let mut binary: Vec<u8> = corners.iter().flat_map(vertex).collect();
    binary.extend([0, 1, 2, 3]);
    binary.extend([[255u8, 0, 0, 0]; 5].as_flattened());
    binary.extend([[0.0f32, 1.0, 0.0]; 5].as_flattened().iter().flat_map(|c| c.to_le_bytes()));
    let document = json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 3}, "indices": 2, "mode": 6}
        ]}],
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 120, "byteStride": 24},
            {"buffer": 0, "byteOffset": 120, "byteLength": 4},
            {"buffer": 0, "byteOffset": 124, "byteLength": 20, "byteStride": 4},
            {"buffer": 0, "byteOffset": 144, "byteLength": 60},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 5, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5121, "normalized": true, "count": 5, "type": "VEC3"},
            {"bufferView": 3, "componentType": 5126, "count": 5, "type": "VEC3"},
        ],
    });
    (document, binary)
}

fn file(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, content) in [(b"JSON", &text[..]), (b"BIN\0", binary)] {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(content);
    }
    bytes
}

fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    Mesh::from_bytes(Path::new("a.glb"), bytes).map_err(|e| e.to_string())
}

#[test]
fn layouts_of_other_programs_are_read() {
    let (mut document, binary) = document();
    for (mode, faces) in
        [(0, vec![]), (4, vec![[0, 1, 2]]), (5, vec![[0, 1, 2], [2, 1, 3]]), (6, vec![[0, 1, 2], [0, 2, 3]])]
    {
        document["meshes"][0]["primitives"][0]["mode"] = json!(mode);
        for (colors, expected) in [(3, [255, 0, 0]), (4, [0, 255, 0])] {
            document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
            let mesh = parse(&file(&document, &binary)).unwrap();
            assert_eq!((&mesh.faces, &mesh.colors), (&faces, &vec![expected; 5]), "mode {mode}");
            assert_eq!(mesh.vertices[2], [1000.0, -1000.0, 0.0]);
            assert_eq!(mesh.normals, [[0.0, 0.0, -1.0]; 5]);
        }
    }
    document["meshes"][0]["primitives"][0]["mode"] = json!(1);
    assert!(parse(&file(&document, &binary)).unwrap().vertices.is_empty(), "lines are no surface");
}

/// As a matrix, and as translation, rotation and scale: a quarter turn about z, twice the size, one meter up.
#[test]
fn both_kinds_of_transform_are_one() {
    let (mut document, binary) = document();
    let half = 0.5f64.sqrt();
    let parts = json!({"mesh": 0, "translation": [0, 1, 0], "rotation": [0, 0, half, half], "scale": [2, 2, 2]});
    let matrix = json!({"mesh": 0, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 0, 1, 0, 1]});
    for node in [parts, matrix] {
        document["nodes"][0] = node;
        let mesh = parse(&file(&document, &binary)).unwrap();
        for (found, expected) in mesh.vertices.iter().zip([[0.0, -1000.0, 0.0], [0.0, -3000.0, 0.0]]) {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?} {expected:?}");
        }
        assert!(mesh.normals.iter().all(|n| (n[2] + 1.0).abs() < 1e-6));
    }
}

#[test]
fn what_is_not_there_is_named() {
    let (document, binary) = document();
    for (place, value, expected) in [
        ("/scenes/0/nodes/0", json!(1), "no node 1"),
        ("/nodes/0/mesh", json!(1), "no mesh 1"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(9), "no accessor 9"),
        ("/meshes/0/primitives/0/indices", json!(9), "no accessor 9"),
        ("/meshes/0/primitives/0/mode", json!(7), "unknown mode 7"),
        ("/accessors/0/bufferView", json!(9), "no buffer view 9"),
        ("/accessors/0/type", json!("VEC2"), "accessor 0 is a VEC2"),
        ("/accessors/1/componentType", json!(5123), "component type 5123"),
        ("/accessors/1/count", json!(4), "not one value per vertex"),
        ("/accessors/0/count", json!(6), "needs data that are not there"),
        ("/accessors/0/count", json!(u64::MAX), "needs data that are not there"),
        ("/bufferViews/0/byteStride", json!(8), "needs data that are not there"),
        ("/bufferViews/0/byteLength", json!(u64::MAX), "needs data that are not there"),
        ("/bufferViews/0/buffer", json!(1), "outside the file"),
        ("/buffers/0", json!({"byteLength": 204, "uri": "a.bin"}), "outside the file"),
        ("/accessors/0", json!({"componentType": 5126, "count": 5, "type": "VEC3", "sparse": {}}), "is sparse"),
        ("/scenes", json!([]), "no scene"),
    ] {
        let mut broken = document.clone();
        *broken.pointer_mut(place).unwrap() = value;
        let e = parse(&file(&broken, &binary)).unwrap_err();
        assert!(e.contains(expected), "{place}: {e}");
    }
    let mut compressed = document;
    compressed["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert!(parse(&file(&compressed, &binary)).unwrap_err().contains("KHR_draco_mesh_compression"));
}
