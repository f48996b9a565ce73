//! Closed forms as triangles.

use nelu3d_scan::Mesh;

/// Rings of a tessellated solid of revolution; 256 keep chords within 0.01 mm of a 100 mm ball.
pub(super) const N_RINGS: usize = 256;

/// Segments of a tessellated solid of revolution.
pub(super) const N_SEGMENTS: usize = 256;

/// Returns the mesh with every triangle cut into four at the middles of its sides. New vertices get the mean of their
/// ends' normals, which is not of unit length where the surface bends.
///
/// # Panics
///
/// If the mesh has no normals.
pub fn subdivide(mesh: &Mesh) -> Mesh {
    let mut fine = Mesh { faces: Vec::with_capacity(4 * mesh.faces.len()), ..mesh.clone() };
    let mut middles = std::collections::HashMap::new();
    for &[a, b, c] in &mesh.faces {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j)| {
            *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                let mean = |v: &[[f32; 3]]| -> [f32; 3] {
                    std::array::from_fn(|k| 0.5 * (v[i as usize][k] + v[j as usize][k]))
                };
                fine.vertices.push(mean(&mesh.vertices));
                fine.normals.push(mean(&mesh.normals));
                fine.vertices.len() as u32 - 1
            })
        });
        fine.faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    fine
}

/// Closes the first (lowest) and last ring of a revolved surface by discs of `rings` rings of triangles.
pub(super) fn close_with_discs(mesh: &mut Mesh, rings: usize) {
    for (ring, ny) in [(0, 1.0f32), (N_RINGS, -1.0)] {
        let rim: Vec<[f32; 3]> = mesh.vertices[ring * N_SEGMENTS..][..N_SEGMENTS].to_vec();
        let center = mesh.vertices.len() as u32;
        mesh.vertices.push([0.0, rim[0][1], 0.0]);
        // The rim has a vertex of its own on the disc: its normal is another.
        for k in 1..=rings {
            let part = k as f32 / rings as f32;
            mesh.vertices.extend(rim.iter().map(|[x, y, z]| [x * part, *y, z * part]));
        }
        mesh.normals.resize(mesh.vertices.len(), [0.0, ny, 0.0]);
        let at = |k: usize, j: usize| center + 1 + (k * N_SEGMENTS + j % N_SEGMENTS) as u32;
        let mut push = |[a, b, c]: [u32; 3]| mesh.faces.push(if ny > 0.0 { [a, c, b] } else { [a, b, c] });
        for j in 0..N_SEGMENTS {
            push([center, at(0, j), at(0, j + 1)]);
            for k in 1..rings {
                push([at(k - 1, j), at(k, j), at(k, j + 1)]);
                push([at(k - 1, j), at(k, j + 1), at(k - 1, j + 1)]);
            }
        }
    }
}

/// Returns a closed surface of revolution about the y axis as triangles: `ring(i)` for i in 0..=N_RINGS is
/// `[y, radius, normal_y, normal_r]` from the bottom (largest y) to the top.
pub(super) fn revolve(ring: impl Fn(usize) -> [f64; 4]) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=N_RINGS {
        let [y, r, ny, nr] = ring(i);
        for j in 0..N_SEGMENTS {
            let (s, c) = (std::f64::consts::TAU * j as f64 / N_SEGMENTS as f64).sin_cos();
            mesh.vertices.push([(r * c) as f32, y as f32, (r * s) as f32]);
            mesh.normals.push([(nr * c) as f32, ny as f32, (nr * s) as f32]);
        }
    }
    let at = |i: usize, j: usize| (i * N_SEGMENTS + j % N_SEGMENTS) as u32;
    for i in 0..N_RINGS {
        for j in 0..N_SEGMENTS {
            mesh.faces.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            mesh.faces.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    mesh
}
