//! A ball of triangles.

use nalgebra::Vector3;
use nelu3d_scan::Mesh;
use nelu3d_sim::scene::tessellation::subdivide;

/// Returns a ball of 20 · 4^levels triangles with exact vertices and normals.
pub(crate) fn icosphere(radius: f32, levels: usize) -> Mesh {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let mut vertices = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        vertices.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    // The faces of an icosahedron are its triples of vertices at distance 2.
    let near = |i: usize, j: usize| (Vector3::from(vertices[i]) - Vector3::from(vertices[j])).norm() < 2.01;
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(i, k) {
                    let [a, b, c] = [i, j, k].map(|i| Vector3::from(vertices[i]));
                    let outward = (b - a).cross(&(c - a)).dot(&a) > 0.0;
                    faces.push(if outward { [i, j, k] } else { [i, k, j] }.map(|i| i as u32));
                }
            }
        }
    }
    let mut mesh = Mesh { normals: vertices.clone(), vertices, faces, ..Mesh::default() };
    mesh = (0..levels).fold(mesh, |m, _| subdivide(&m));
    for (v, n) in mesh.vertices.iter_mut().zip(&mut mesh.normals) {
        *n = Vector3::from(*v).normalize().into();
        *v = n.map(|c| c * radius);
    }
    mesh
}
