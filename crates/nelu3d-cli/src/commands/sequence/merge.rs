//! Meshes made smaller, so that an animation of many fits into a file.

use std::collections::HashMap;

use nelu3d_scan::Mesh;
use nelu3d_scan::statistics::median;

/// Merges all vertices in a cube of `cells` times the typical edge into their mean.
pub(super) fn merge_vertices(mesh: &Mesh, cells: f64) -> Mesh {
    let edge = |f: &[u32; 3]| {
        let (a, b) = (mesh.vertices[f[0] as usize], mesh.vertices[f[1] as usize]);
        (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt()
    };
    let mut edges: Vec<f32> = mesh.faces.iter().step_by(mesh.faces.len() / 1000 + 1).map(edge).collect();
    let Some(typical) = median(&mut edges) else { return mesh.clone() };
    let side = typical.max(1e-6) * cells as f32;
    let mut index = HashMap::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let of: Vec<u32> = mesh
        .vertices
        .iter()
        .enumerate()
        .map(|(i, v)| {
            let slot = *index.entry(v.map(|c| (c / side).floor() as i64)).or_insert_with(|| {
                groups.push(Vec::new());
                groups.len() - 1
            });
            groups[slot].push(i);
            slot as u32
        })
        .collect();
    let mean = |values: &[[f32; 3]], group: &[usize]| -> [f32; 3] {
        std::array::from_fn(|c| group.iter().map(|i| values[*i][c]).sum::<f32>() / group.len() as f32)
    };
    let unit = |v: [f32; 3]| {
        let length = v.iter().map(|c| c * c).sum::<f32>().sqrt().max(1e-12);
        v.map(|c| c / length)
    };
    let each = |values: &[[f32; 3]]| groups.iter().map(|g| mean(values, g)).collect::<Vec<_>>();
    Mesh {
        vertices: each(&mesh.vertices),
        normals: if mesh.normals.is_empty() { Vec::new() } else { each(&mesh.normals).into_iter().map(unit).collect() },
        colors: if mesh.colors.is_empty() { Vec::new() } else { groups.iter().map(|g| mesh.colors[g[0]]).collect() },
        faces: mesh
            .faces
            .iter()
            .map(|f| f.map(|i| of[i as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat sheet of unit squares: merged twice as coarse it is still that sheet, with a quarter of the vertices.
    #[test]
    fn merging_keeps_the_surface() {
        let n = 20usize;
        let vertices: Vec<[f32; 3]> = (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 500.0]).collect();
        let square = |i: u32| [[i, i + 1, i + n as u32], [i + 1, i + 1 + n as u32, i + n as u32]];
        let corner = |i: &usize| i % n + 1 < n && i / n + 1 < n;
        let faces: Vec<[u32; 3]> = (0..n * n).filter(corner).flat_map(|i| square(i as u32)).collect();
        let normals = vec![[0.0, 0.0, -1.0]; n * n];
        let colors = (0..n * n).map(|i| [i as u8, 0, 0]).collect();
        let small = merge_vertices(&Mesh { vertices, normals, colors, faces }, 2.0);
        assert_eq!(small.vertices.len(), n * n / 4);
        assert_eq!((small.normals.len(), small.colors.len()), (n * n / 4, n * n / 4));
        assert!(small.vertices.iter().all(|v| v[2] == 500.0) && small.normals.iter().all(|n| *n == [0.0, 0.0, -1.0]));
        let area: f32 = small
            .faces
            .iter()
            .map(|f| {
                let [a, b, c] = f.map(|i| small.vertices[i as usize]);
                0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
            })
            .sum();
        assert!((area - 18.0 * 18.0).abs() < 1e-3, "{area}");
    }
}
