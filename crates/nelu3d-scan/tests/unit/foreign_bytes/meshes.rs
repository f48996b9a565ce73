//! PLY, OBJ, STL and GLB.

use std::path::Path;
use std::sync::LazyLock;

use nelu3d_scan::Mesh;
use rand::RngExt;
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;

use super::mutation::{arbitrary, damaged};
use super::{cases, watched};
use crate::mesh::tetrahedron;

fn written(mesh: &Mesh, ending: &str) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(format!("a.{ending}"));
    mesh.write(&path).unwrap();
    std::fs::read(path).unwrap()
}

/// Valid files of every kind, with their endings.
static FILES: LazyLock<Vec<(&str, Vec<u8>)>> = LazyLock::new(|| {
    let (full, text) = (
        tetrahedron(),
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property double z\nproperty list uchar short extra\nelement face 1\nproperty list uchar int vertex_indices\n\
        end_header\n0 0 0 1 5\n1 0 0 0\n0 1 0 2 1 2\n3 0 1 2\n",
    );
    let facet = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
        endsolid a\n";
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -1 -2 -3\n";
    let points = Mesh { faces: vec![], normals: vec![], ..full.clone() };
    let mut files: Vec<(&str, Vec<u8>)> = ["ply", "obj", "stl", "glb"].map(|e| (e, written(&full, e))).into();
    files.extend([("ply", text.into()), ("stl", facet.into()), ("obj", obj.into())]);
    files.extend(["ply", "glb"].map(|e| (e, written(&points, e))));
    files
});

fn read(ending: &str, bytes: &[u8]) {
    let path = format!("a.{ending}");
    if let Ok(mut mesh) = watched(|| Mesh::from_bytes(Path::new(&path), bytes)) {
        // What has been read can be worked with and written.
        watched(|| mesh.compute_normals());
        assert!(mesh.faces.iter().flatten().all(|&i| (i as usize) < mesh.vertices.len()));
    }
}

#[test]
fn damaged_meshes_are_refused_or_read() {
    cases(1500, |rng| {
        let (ending, file) = FILES.choose(rng).expect("files");
        read(ending, &damaged(file, rng));
    });
}

#[test]
fn arbitrary_bytes_are_no_mesh() {
    cases(1500, |rng| {
        let beginnings: [&[u8]; 5] = [
            b"",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n",
            b"solid a\n",
            b"glTF\x02\0\0\0",
            b"v 0 0 0\nv 1 0 0\nf 1 2 ",
        ];
        let bytes = arbitrary(&beginnings, rng);
        for ending in ["ply", "obj", "stl", "glb"] {
            read(ending, &bytes);
        }
    });
}

/// Any finite position that survives being written in meters, as GLB demands.
fn position(rng: &mut StdRng) -> [f32; 3] {
    [rng.random_range(-1e4..1e4), rng.random_range(-1e4..1e4), rng.random_range(0.0..1e4)]
}

fn mesh(rng: &mut StdRng) -> Mesh {
    let n = rng.random_range(1..12);
    let vertices = (0..n).map(|_| position(rng)).collect();
    let faces = (0..rng.random_range(0..12)).map(|_| std::array::from_fn(|_| rng.random_range(0..n as u32))).collect();
    let colors = if rng.random() { (0..n).map(|_| rng.random()).collect() } else { vec![] };
    Mesh { vertices, faces, colors, normals: vec![] }
}

#[test]
fn meshes_round_trip() {
    cases(128, |rng| {
        let mesh = mesh(rng);
        let back = |ending: &str| Mesh::from_bytes(Path::new(&format!("a.{ending}")), &written(&mesh, ending)).unwrap();
        assert_eq!(back("ply"), mesh);
        if !mesh.faces.is_empty() {
            let obj = back("obj");
            let corners = |m: &Mesh| -> Vec<[[f32; 3]; 3]> {
                m.faces.iter().map(|f| f.map(|i| m.vertices[i as usize])).collect()
            };
            assert_eq!(corners(&obj), corners(&mesh));
            assert_eq!(corners(&back("stl")), corners(&mesh));
            let glb = back("glb");
            assert_eq!((&glb.faces, &glb.colors), (&mesh.faces, &mesh.colors));
            for (a, b) in glb.vertices.iter().flatten().zip(mesh.vertices.iter().flatten()) {
                assert!((a - b).abs() <= 2e-7 * b.abs(), "{a} for {b}");
            }
        }
    });
}
