mod glb;
mod threemf;

use std::fs;
use std::path::Path;

use nelu3d_scan::Mesh;
use nelu3d_scan::mesh::{TexturedMesh, write_points, write_textured_glb, write_textured_obj};

/// A tetrahedron with outward faces.
pub(crate) fn tetrahedron() -> Mesh {
    let mut mesh = Mesh {
        vertices: vec![[0.0, 0.0, 500.25], [10.5, 0.0, 500.0], [0.0, 11.0, 500.0], [0.125, 0.25, 490.0]],
        colors: vec![[255, 0, 0], [0, 128, 0], [1, 2, 3], [250, 251, 252]],
        faces: vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]],
        normals: vec![],
    };
    mesh.compute_normals();
    mesh
}

fn complaint(path: &Path) -> String {
    let e = Mesh::read(path).unwrap_err().to_string();
    assert!(e.contains(&path.file_name().unwrap().to_string_lossy().into_owned()), "file not named: {e}");
    e
}

#[test]
fn meshes_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let full = tetrahedron();
    let variants = [
        full.clone(),
        Mesh { normals: vec![], ..full.clone() },
        Mesh { colors: vec![], ..full.clone() },
        Mesh { colors: vec![], normals: vec![], ..full.clone() },
    ];
    for ending in ["ply", "PLY", "obj", "stl"] {
        let path = dir.path().join(format!("a.{ending}"));
        for mesh in &variants {
            mesh.write(&path).unwrap();
            let back = Mesh::read(&path).unwrap();
            if ending == "stl" {
                // STL has no shared vertices: the triangles are what is kept.
                let corners =
                    |m: &Mesh| -> Vec<_> { m.faces.iter().map(|f| f.map(|i| m.vertices[i as usize])).collect() };
                assert_eq!(corners(&back), corners(mesh));
                assert_eq!(back.vertices.len(), 4, "corners are merged");
                continue;
            }
            assert_eq!(
                (&back.vertices, &back.faces, &back.colors),
                (&mesh.vertices, &mesh.faces, &mesh.colors),
                "{ending}"
            );
            assert_eq!(back.normals.len(), mesh.normals.len());
            for (a, b) in back.normals.iter().flatten().zip(mesh.normals.iter().flatten()) {
                assert!((a - b).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn point_clouds_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("points.ply");
    let m = tetrahedron();
    write_points(&path, &m.vertices, &m.normals, &m.colors, &[]).unwrap();
    let back = Mesh::read(&path).unwrap();
    assert_eq!((back.vertices, back.colors, back.faces.len()), (m.vertices, m.colors, 0));
    write_points(&path, &[], &[], &[], &[]).unwrap();
    assert_eq!(Mesh::read(&path).unwrap(), Mesh::default());
}

#[test]
fn normals_are_area_weighted_and_point_outward() {
    // Two triangles of a fold meet in the edge 0-1; the second has four times the area of the first.
    let mut fold = Mesh {
        vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 4.0], [9.0; 3]],
        faces: vec![[0, 1, 2], [1, 0, 3]],
        ..Mesh::default()
    };
    fold.compute_normals();
    assert_eq!(fold.normals[2], [0.0, 0.0, 1.0]);
    assert_eq!(fold.normals[3], [0.0, 1.0, 0.0]);
    let expected = [0.0, 4.0 / 17f32.sqrt(), 1.0 / 17f32.sqrt()];
    assert!(fold.normals[0].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", fold.normals[0]);
    assert_eq!(fold.normals[4], [0.0; 3], "no triangle, no direction");
    let t = tetrahedron();
    let center = [3.0f32, 3.0, 497.0];
    for (v, n) in t.vertices.iter().zip(&t.normals) {
        let outward: f32 = (0..3).map(|i| (v[i] - center[i]) * n[i]).sum();
        assert!(outward > 0.0, "{v:?} {n:?}");
    }
}

#[test]
fn other_peoples_files_are_understood() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    fs::write(
        path("ascii.ply"),
        "ply\r\nformat ascii 1.0\r\ncomment x\r\nelement vertex 4\r\nproperty double x\r\nproperty double y\r\n\
         property double z\r\nproperty float red\r\nproperty float green\r\nproperty float blue\r\n\
         property list uchar int tags\r\n\
         element edge 1\r\nproperty int a\r\nelement face 1\r\nproperty uchar flag\r\n\
         property list uchar uint vertex_index\r\n\
         end_header\r\n0 0 0 1 0.5 0 0\r\n1 0 0 0 0 0 2 7 7\r\n1 1 0 0 0 0 0\r\n0 1 0 0 0 0 0\r\n5\r\n9 4 0 1 2 3\r\n",
    )
    .unwrap();
    let m = Mesh::read(&path("ascii.ply")).unwrap();
    assert_eq!((m.vertices[2], m.colors[0], m.faces), ([1.0, 1.0, 0.0], [255, 128, 0], vec![[0, 1, 2], [0, 2, 3]]));

    let mut big =
        b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty short y\nproperty double z\n\
        element face 1\nproperty list uchar ushort vertex_indices\nend_header\n"
            .to_vec();
    for i in 0..3i16 {
        big.extend(f32::from(i).to_be_bytes());
        big.extend((-i).to_be_bytes());
        big.extend((0.5 * f64::from(i)).to_be_bytes());
    }
    big.extend([3, 0, 0, 0, 1, 0, 2]);
    fs::write(path("big.ply"), big).unwrap();
    let m = Mesh::read(&path("big.ply")).unwrap();
    assert_eq!((m.vertices[2], m.faces), ([2.0, -2.0, 1.0], vec![[0, 1, 2]]));

    fs::write(
        path("two.obj"),
        "mtllib none.mtl\no a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl red\nf 1 2 3 4\no b\n\
         v 0 0 5\nf -1/1 1//1 2\n",
    )
    .unwrap();
    // Materials and texture coordinates that are not there do not matter to the shape.
    assert_eq!(Mesh::read(&path("two.obj")).unwrap().faces.len(), 3);
    fs::write(
        path("two.obj"),
        "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\no b\n\
         v 0 0 5\nf -1 1 2\n",
    )
    .unwrap();
    let m = Mesh::read(&path("two.obj")).unwrap();
    assert_eq!(m.faces.len(), 3);
    let corners: Vec<_> = m.faces[2].iter().map(|&i| m.vertices[i as usize]).collect();
    assert_eq!(corners, [[0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);

    fs::write(
        path("a.stl"),
        "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
         endloop\nendfacet\nendsolid x\n",
    )
    .unwrap();
    assert_eq!(Mesh::read(&path("a.stl")).unwrap().faces, [[0, 1, 2]]);
    tetrahedron().write(&path("b.stl")).unwrap();
    let mut bytes = fs::read(path("b.stl")).unwrap();
    bytes[..5].copy_from_slice(b"solid");
    fs::write(path("b.stl"), bytes).unwrap();
    assert_eq!(Mesh::read(&path("b.stl")).unwrap().faces.len(), 4);
}

#[test]
fn glb_is_valid_and_upright() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let mesh = Mesh { normals: vec![], ..tetrahedron() };
    mesh.write(&path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let word = |i: usize| u32::from_le_bytes(bytes[i..i + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let json_length = word(12);
    assert_eq!(&bytes[16..20], b"JSON");
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_length]).unwrap();
    let chunk = 20 + json_length;
    assert_eq!(&bytes[chunk + 4..chunk + 8], b"BIN\0");
    assert_eq!(word(chunk), bytes.len() - chunk - 8);
    assert_eq!(json["buffers"][0]["byteLength"], bytes.len() - chunk - 8);

    let primitive = &json["meshes"][0]["primitives"][0];
    let bin = &bytes[chunk + 8..];
    let start = |accessor: &serde_json::Value| {
        let view = json["accessors"][accessor.as_u64().unwrap() as usize]["bufferView"].as_u64().unwrap() as usize;
        json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize
    };
    let floats = |accessor: &serde_json::Value| -> Vec<f32> {
        bin[start(accessor)..].chunks(4).take(12).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    let positions = floats(&primitive["attributes"]["POSITION"]);
    for (p, v) in positions.chunks(3).zip(&mesh.vertices) {
        assert_eq!(p, [v[0] / 1000.0, -v[1] / 1000.0, -v[2] / 1000.0]);
    }
    let normals = floats(&primitive["attributes"]["NORMAL"]);
    assert!(normals.chunks(3).all(|n| (n.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-5));
    let at = start(&primitive["indices"]);
    let indices: Vec<u32> = bin[at..].chunks(2).map(|b| u16::from_le_bytes(b.try_into().unwrap()).into()).collect();
    assert_eq!(indices, mesh.faces.concat());
    let red = start(&primitive["attributes"]["COLOR_0"]);
    assert_eq!(bin[red..red + 8], [255, 255, 0, 0, 0, 0, 255, 255]);

    Mesh::default().write(&path).unwrap();
    assert_eq!(&fs::read(&path).unwrap()[..4], b"glTF");
}

#[test]
fn bad_files_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    assert!(complaint(&path("none.ply")).contains("cannot be read"));
    assert!(complaint(&path("a.step")).contains("give a .ply, .obj, .stl or .glb file"));
    let e = tetrahedron().write(&path("a.step")).unwrap_err().to_string();
    assert!(e.contains("a.step") && e.contains("name it .ply, .obj, .stl, .glb, or .3mf"), "{e}");
    assert!(tetrahedron().write(&path("no/folder/a.ply")).unwrap_err().to_string().contains("a.ply"));
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
    for (body, expected) in [
        ("3 0 1 3\n", "the face [0, 1, 3] needs a vertex"),
        ("3 0 1 -1\n", "a face has the vertex -1"),
        ("3 0 1 x\n", "`x` is not a number"),
        ("4294967295 0 1", "truncated"),
        ("", "truncated"),
    ] {
        fs::write(path("a.ply"), format!("{header}{body}")).unwrap();
        let e = complaint(&path("a.ply"));
        assert!(e.contains(expected), "{e} instead of {expected}");
    }
    for (from, to, expected) in [
        ("ply\n", "plx\n", "does not start with `ply`"),
        ("ascii", "morse", "its format is morse"),
        ("property float z\n", "", "do not have x, y, z"),
        ("float z", "complex z", "unknown type complex"),
        ("end_header\n", "", "its header has the line"),
        ("vertex 3", "vertex 9999999999999", "not a number"),
        ("0 1 0\n", "0 1 nan\n", "vertex 2 is at"),
    ] {
        fs::write(path("a.ply"), format!("{}3 0 1 2\n", header.replacen(from, to, 1))).unwrap();
        let e = complaint(&path("a.ply"));
        assert!(e.contains(expected) || e.contains("truncated"), "{e} instead of {expected}");
    }
    fs::write(path("a.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
    complaint(&path("a.obj"));
    fs::write(path("a.obj"), "nothing\n").unwrap();
    complaint(&path("a.obj"));
}

#[test]
fn damaged_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.ply", "a.obj", "a.stl", "a.glb"] {
        let path = dir.path().join(name);
        tetrahedron().write(&path).unwrap();
        let whole = fs::read(&path).unwrap();
        let parse = |bytes: &[u8]| Mesh::from_bytes(&path, bytes);
        for i in 0..whole.len() {
            let _ = parse(&whole[..i]);
            for flip in [0x01, 0x10, 0xff] {
                let mut bytes = whole.clone();
                bytes[i] ^= flip;
                let _ = parse(&bytes);
            }
        }
    }
}

#[test]
fn glb_round_trips() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let full = tetrahedron();
    for mesh in [full.clone(), Mesh { colors: vec![], ..full.clone() }, Mesh { faces: vec![], ..full }] {
        mesh.write(&path).unwrap();
        let back = Mesh::read(&path).unwrap();
        assert_eq!((&back.faces, &back.colors), (&mesh.faces, &mesh.colors));
        assert_eq!((back.vertices.len(), back.normals.len()), (mesh.vertices.len(), mesh.normals.len()));
        for (a, b) in back.vertices.iter().flatten().zip(mesh.vertices.iter().flatten()) {
            // Meters and back: two roundings.
            assert!((a - b).abs() <= 2e-7 * b.abs(), "{a} instead of {b}");
        }
        for (a, b) in back.normals.iter().flatten().zip(mesh.normals.iter().flatten()) {
            assert!((a - b).abs() < 1e-6);
        }
    }
    Mesh::default().write(&path).unwrap();
    assert_eq!(Mesh::read(&path).unwrap(), Mesh::default());
}

/// A file whose triangle is used by two nodes below a third: one moved, one mirrored and stretched.
#[test]
fn glb_nodes_are_placed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("nodes.glb");
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut bin: Vec<u8> = corners.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    bin.extend([[0.0f32, 0.0, 1.0]; 3].iter().flatten().flat_map(|c| c.to_le_bytes()));
    let write = |nodes: serde_json::Value| {
        let json = serde_json::json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]}],
            "buffers": [{"byteLength": 72}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 36}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                 "min": [0, 0, 0], "max": [1, 1, 0]},
                {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
            ],
        });
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend(((28 + text.len() + bin.len()) as u32).to_le_bytes());
        bytes.extend((text.len() as u32).to_le_bytes());
        bytes.extend(b"JSON");
        bytes.extend(&text);
        bytes.extend((bin.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.extend(&bin);
        fs::write(&path, bytes).unwrap();
    };
    write(serde_json::json!([
        {"translation": [0, 0, 1], "children": [1, 2]},
        {"mesh": 0, "translation": [0, 2, 0]},
        {"mesh": 0, "scale": [-2, 1, 1]},
    ]));
    let mesh = Mesh::read(&path).unwrap();
    let triangles: Vec<_> = mesh.faces.iter().map(|f| f.map(|i| mesh.vertices[i as usize])).collect();
    let moved = [[0.0, -2000.0, -1000.0], [1000.0, -2000.0, -1000.0], [0.0, -3000.0, -1000.0]];
    // Mirrored, and its corners in the other order, so that it faces where it did.
    let mirrored = [[0.0, 0.0, -1000.0], [0.0, -1000.0, -1000.0], [-2000.0, 0.0, -1000.0]];
    assert!(triangles.len() == 2 && triangles.contains(&moved) && triangles.contains(&mirrored), "{triangles:?}");
    assert!(mesh.normals.iter().all(|n| *n == [0.0, 0.0, -1.0]), "{:?}", mesh.normals);

    write(serde_json::json!([{"mesh": 0, "children": [1]}, {"children": [0]}]));
    assert!(complaint(&path).contains("hangs from two others"));
}

/// The archive is read by its own rules: stated millimeters, the same numbers, the same triangles.
#[test]
fn threemf_has_the_same_mesh_in_millimeters() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("mesh.3mf");
    let mesh = Mesh {
        vertices: vec![[0.1, -2.5, 700.25], [1e-7, 3.0, 699.0], [-4.0, 0.3, 1e4]],
        faces: vec![[0, 1, 2], [2, 1, 0]],
        ..Mesh::default()
    };
    mesh.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(threemf::read_own(&bytes), mesh);
    mesh.write(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes, "the same mesh is the same file");
}

/// The picture comes back as it was, and places in it count from its upper left corner in .glb, from below in .obj.
#[test]
fn textured_meshes_carry_their_picture() {
    let dir = tempfile::tempdir().unwrap();
    let mesh = Mesh {
        vertices: vec![[0.0, 0.0, 700.0], [10.0, 0.0, 700.0], [0.0, 10.0, 710.0]],
        normals: vec![[0.0, 0.0, -1.0]; 3],
        colors: vec![[9, 9, 9]; 3],
        faces: vec![[0, 2, 1]],
    };
    let (uv, png) =
        ([[0.125, 0.25], [0.5, 0.25], [0.125, 1.0]], nelu3d_scan::image::encode_rgb8(2, 1, &[1, 2, 3, 200, 100, 50]));
    let textured = TexturedMesh { mesh: &mesh, uv: &uv, png: &png };

    let path = dir.path().join("t.glb");
    write_textured_glb(&path, &textured).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = file.blob.as_deref().unwrap();
    let image = file.images().next().unwrap();
    let gltf::image::Source::View { view, mime_type } = image.source() else { panic!("inside the file") };
    assert_eq!((mime_type, &blob[view.offset()..view.offset() + view.length()]), ("image/png", &png[..]));
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    assert!(primitive.material().pbr_metallic_roughness().base_color_texture().is_some());
    let read = primitive.reader(|_| Some(blob));
    assert_eq!(read.read_tex_coords(0).unwrap().into_f32().collect::<Vec<_>>(), uv);
    assert!(read.read_colors(0).is_none());
    // Its shape is that of any .glb.
    assert_eq!(Mesh::read(&path).unwrap().faces, mesh.faces);

    let path = dir.path().join("t.obj");
    write_textured_obj(&path, &textured).unwrap();
    assert_eq!(std::fs::read(dir.path().join("t.png")).unwrap(), png);
    let load = |p: &Path| tobj::load_mtl(dir.path().join(p));
    let (models, materials) =
        tobj::load_obj_buf(&mut &std::fs::read(&path).unwrap()[..], &tobj::GPU_LOAD_OPTIONS, load).unwrap();
    assert_eq!(materials.unwrap()[0].diffuse_texture.as_deref(), Some("t.png"));
    let found = &models[0].mesh;
    assert_eq!(found.positions.as_chunks::<3>().0.len(), 3);
    for (corner, place) in found.texcoords.as_chunks::<2>().0.iter().enumerate() {
        let vertex = found.positions.as_chunks::<3>().0[corner];
        let i = mesh.vertices.iter().position(|v| *v == vertex).unwrap();
        assert_eq!([place[0], 1.0 - place[1]], uv[i]);
    }
}
