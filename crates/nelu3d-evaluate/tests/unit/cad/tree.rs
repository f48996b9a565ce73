use nalgebra::Point3;
use nelu3d_evaluate::cad::tree::{Feature, TriangleTree};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Random triangles against a search through all of them, and against points all over each triangle.
#[test]
fn nothing_is_closer() {
    let mut rng = StdRng::seed_from_u64(7);
    let mut point = |scale: f64| Point3::from([0; 3].map(|_| scale * rng.random_range(-1.0..1.0)));
    let mut vertices = Vec::new();
    for _ in 0..200 {
        let center = point(10.0);
        vertices.extend([0; 3].map(|_| center + point(2.0).coords));
    }
    let faces: Vec<[u32; 3]> = (0..200).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let tree = TriangleTree::new(vertices, faces);
    let mut seen = [0; 3];
    for _ in 0..500 {
        let p = point(15.0);
        let found = tree.closest(&p, f64::MAX).unwrap();
        let distance = (found.point - p).norm();
        for face in 0..200 {
            let [a, b, c] = tree.corners(face);
            for (i, j) in (0..=10).flat_map(|i| (0..=10 - i).map(move |j| (f64::from(i) / 10.0, f64::from(j) / 10.0))) {
                let q = a + (b - a) * i + (c - a) * j;
                assert!((q - p).norm() >= distance - 1e-12, "{p} has {q} nearer than {found:?}");
            }
        }
        // It lies on the part that is named.
        let corners = tree.corners(found.face);
        match found.feature {
            Feature::Vertex(i) => assert_eq!(found.point, corners[i]),
            Feature::Edge(i) => {
                let (a, b) = (corners[i], corners[(i + 1) % 3]);
                assert!((found.point - a).cross(&(b - a)).norm() < 1e-9);
                assert!((p - found.point).dot(&(b - a)).abs() < 1e-9);
            }
            Feature::Face => {
                let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
                assert!((p - found.point).cross(&normal).norm() < 1e-9);
            }
        }
        seen[match found.feature {
            Feature::Face => 0,
            Feature::Edge(_) => 1,
            Feature::Vertex(_) => 2,
        }] += 1;
        assert!(tree.closest(&p, 0.999 * distance).is_none() && tree.closest(&p, 1.001 * distance).is_some());
    }
    assert!(seen.iter().all(|&n| n > 30), "{seen:?}");
}
