//! A surface small enough to live inside a page: clustered, quantized, base64.

use std::collections::HashMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nelu3d_scan::Mesh;

/// Maximum number of vertices of a page: their numbers fit 16 bits, and all of it stays below 2 MB.
const MAX_VERTICES: usize = 48_000;

/// What the page's viewer reads, as the content of a JSON script block.
#[derive(serde::Serialize)]
pub(crate) struct PageMesh {
    /// Number of vertices.
    vertices: usize,
    /// Number of triangles.
    faces: usize,
    /// A corner of the bounding box, mm.
    low: [f32; 3],
    /// Size of one step of the quantized coordinates, mm.
    step: f32,
    /// Twelve bytes per vertex: x y z as little-endian u16, normal as three i8, color as three u8.
    vertex_data: String,
    /// Three little-endian u16 per triangle.
    face_data: String,
}

impl PageMesh {
    /// Clusters and packs a surface; `None` when it has no triangles.
    pub(crate) fn of(mesh: &Mesh) -> Option<Self> {
        let mesh = clustered(mesh, MAX_VERTICES);
        if mesh.faces.is_empty() {
            return None;
        }
        let (low, high) = bounds(&mesh);
        let size = (0..3).map(|a| high[a] - low[a]).fold(0.0, f32::max);
        let step = if size > 0.0 { size / f32::from(u16::MAX) } else { 1.0 };
        let mut vertex_data = Vec::with_capacity(12 * mesh.vertices.len());
        for (i, v) in mesh.vertices.iter().enumerate() {
            for a in 0..3 {
                vertex_data.extend((((v[a] - low[a]) / step).round() as u16).to_le_bytes());
            }
            vertex_data.extend(mesh.normals[i].map(|n| (n * 127.0).round() as i8 as u8));
            vertex_data.extend(mesh.colors.get(i).copied().unwrap_or([200; 3]));
        }
        let face_data: Vec<u8> = mesh.faces.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()).collect();
        Some(Self {
            vertices: mesh.vertices.len(),
            faces: mesh.faces.len(),
            low,
            step,
            vertex_data: STANDARD.encode(vertex_data),
            face_data: STANDARD.encode(face_data),
        })
    }
}

/// Merges the vertices of each cell of a cubic grid, the finest that leaves at most `limit`; always with normals.
fn clustered(mesh: &Mesh, limit: usize) -> Mesh {
    let (low, high) = bounds(mesh);
    let size = (0..3).map(|a| high[a] - low[a]).fold(0.0, f32::max);
    let cell_of = |v: &[f32; 3], cell: f32| -> [u32; 3] { std::array::from_fn(|a| ((v[a] - low[a]) / cell) as u32) };
    if mesh.vertices.len() <= limit || size <= 0.0 {
        let mut whole = mesh.clone();
        if whole.normals.len() != whole.vertices.len() {
            whole.compute_normals();
        }
        return whole;
    }
    let count = |cell: f32| -> usize {
        let mut keys: Vec<[u32; 3]> = mesh.vertices.iter().map(|v| cell_of(v, cell)).collect();
        keys.sort_unstable();
        keys.dedup();
        keys.len()
    };
    // A surface crosses about (size/cell)² cells, so this start is near, and too fine.
    let mut cell = size / (2.0 * (limit as f32).sqrt());
    loop {
        let n = count(cell);
        if n <= limit {
            break;
        }
        cell *= (n as f32 / limit as f32).sqrt().clamp(1.02, 2.0);
    }

    // Clusters are numbered in the order of their first vertex: the map itself is never iterated.
    let mut number: HashMap<[u32; 3], u32> = HashMap::new();
    let mut sums: Vec<([f64; 3], [f64; 3], f64)> = Vec::new();
    let mut cluster = Vec::with_capacity(mesh.vertices.len());
    for (i, v) in mesh.vertices.iter().enumerate() {
        let c = *number.entry(cell_of(v, cell)).or_insert_with(|| {
            sums.push(([0.0; 3], [0.0; 3], 0.0));
            sums.len() as u32 - 1
        });
        cluster.push(c);
        let sum = &mut sums[c as usize];
        let color = mesh.colors.get(i).copied().unwrap_or([200; 3]);
        for a in 0..3 {
            sum.0[a] += f64::from(v[a]);
            sum.1[a] += f64::from(color[a]);
        }
        sum.2 += 1.0;
    }
    let faces = mesh
        .faces
        .iter()
        .map(|f| f.map(|i| cluster[i as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    let mut small = Mesh {
        vertices: sums.iter().map(|(p, _, n)| p.map(|v| (v / n) as f32)).collect(),
        colors: sums.iter().map(|(_, c, n)| c.map(|v| (v / n) as u8)).collect(),
        normals: Vec::new(),
        faces,
    };
    small.compute_normals();
    small
}

/// Returns the corners of the bounding box.
fn bounds(mesh: &Mesh) -> ([f32; 3], [f32; 3]) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for v in &mesh.vertices {
        for a in 0..3 {
            low[a] = low[a].min(v[a]);
            high[a] = high[a].max(v[a]);
        }
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of n × n vertices, 1 mm apart, at z = 500, facing the camera.
    fn square(n: u32) -> Mesh {
        let at = |x: u32, y: u32| y * n + x;
        let cells = (0..n - 1).flat_map(|y| (0..n - 1).map(move |x| (x, y)));
        Mesh {
            vertices: (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 500.0]).collect(),
            normals: Vec::new(),
            colors: Vec::new(),
            faces: cells
                .flat_map(|(x, y)| {
                    [[at(x, y), at(x, y + 1), at(x + 1, y)], [at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]]
                })
                .collect(),
        }
    }

    #[test]
    fn clustering_keeps_the_surface() {
        let mesh = square(100);
        let small = clustered(&mesh, 1000);
        assert!(small.vertices.len() <= 1000 && small.vertices.len() > 500, "{}", small.vertices.len());
        assert!(small.faces.len() > 2 * 20 * 20);
        assert!(small.vertices.iter().all(|v| v[2] == 500.0));
        assert!(small.normals.iter().all(|n| (n[2] + 1.0).abs() < 1e-6), "the orientation survives");
        assert_eq!(small, clustered(&mesh, 1000));
    }

    #[test]
    fn packing_is_twelve_bytes_a_vertex() {
        let page = PageMesh::of(&square(3)).unwrap();
        let bytes = STANDARD.decode(page.vertex_data).unwrap();
        assert_eq!(bytes.len(), 12 * 9);
        let last = &bytes[8 * 12..];
        assert_eq!(u16::from_le_bytes([last[0], last[1]]), u16::MAX);
        assert_eq!(last[8] as i8, -127);
        assert_eq!(STANDARD.decode(page.face_data).unwrap().len(), 6 * 8);
        assert!(PageMesh::of(&Mesh::default()).is_none());
    }
}
