use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};
use nelu3d_sim::random::{RandomPurpose, generator};
use nelu3d_sim::scene::triangles::{Shear, Triangles};
use rand::RngExt;

use super::icosphere::icosphere;

/// The corners of a mesh's triangle.
fn corners(mesh: &Mesh, face: usize) -> [Point3<f64>; 3] {
    mesh.faces[face].map(|i| Point3::from(mesh.vertices[i as usize].map(f64::from)))
}

/// Every face tested, none left out.
fn brute_force(mesh: &Mesh, ray: &Ray) -> Option<(f64, u32)> {
    let shear = Shear::new(ray);
    let hits = (0..mesh.faces.len()).filter_map(|f| Some((shear.hit(corners(mesh, f).each_ref())?.0, f as u32)));
    hits.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
}

#[test]
fn the_tree_finds_what_testing_every_triangle_finds() {
    let mut random = generator(5, RandomPurpose::Pixels, [0; 3]);
    let mut unit = || 2.0 * random.random::<f64>() - 1.0;
    let mut vector = |scale: f64| Vector3::new(scale * unit(), scale * unit(), scale * unit());
    let (mut hits, mut twice) = (0, 0);
    for far in [0.0, 400.0, 1e5] {
        let mut mesh = Mesh::default();
        for i in 0..600u32 {
            let middle = vector(50.0) + Vector3::new(far, 0.0, -far);
            for _ in 0..3 {
                let p = middle + vector(if i % 3 == 0 { 40.0 } else { 4.0 });
                mesh.vertices.push([p.x as f32, p.y as f32, p.z as f32]);
            }
            mesh.faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
            // Equal triangles, so that the same distance comes twice.
            if i % 10 == 0 {
                mesh.faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
            }
        }
        let triangles = Triangles::new(&mesh, 1.0);
        for i in 0..4000 {
            let origin = Point3::from(vector(300.0)) + Vector3::new(far, 0.0, -far);
            let aim = Point3::from(vector(60.0)) + Vector3::new(far, 0.0, -far);
            let mut dir = (aim - origin).normalize();
            if i % 16 == 0 {
                // Along an axis the boxes' tests divide by zero.
                dir = Vector3::ith(i / 16 % 3, 1.0);
            }
            let ray = Ray { origin, dir };
            let expected = brute_force(&mesh, &ray);
            let got = triangles.hit(&ray, f64::INFINITY);
            let face = got.as_ref().and_then(|m| m.mesh_point).map(|p| p.face);
            assert_eq!(got.map(|m| m.t.to_bits()), expected.map(|e| e.0.to_bits()), "{ray:?}");
            assert_eq!(face, expected.map(|e| e.1), "{ray:?}");
            if let Some((t, face)) = expected {
                hits += 1;
                twice += usize::from(face % 11 == 0);
                assert!(triangles.occludes(&ray, t * (1.0 + 1e-12)) && !triangles.occludes(&ray, t));
                assert!(triangles.hit(&ray, t).is_none());
            }
        }
    }
    assert!(hits > 5000 && twice > 300, "{hits}, {twice}");
}

/// Rays at the edges and corners of a closed surface never pass between two triangles.
#[test]
fn a_closed_surface_has_no_gaps() {
    let n = 24;
    let sphere = icosphere(30.0, 3);
    let mesh = Triangles::new(&sphere, 1.0);
    let mut rays = 0;
    for face in 0..sphere.faces.len() {
        let [a, b, c] = corners(&sphere, face);
        for i in 0..=n {
            let s = f64::from(i) / f64::from(n);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let ray = Ray {
                    origin: Point3::new(1.0, 2.0, 3.0),
                    dir: (from + (to - from) * s - Point3::new(1.0, 2.0, 3.0)).normalize(),
                };
                assert!(mesh.hit(&ray, f64::INFINITY).is_some(), "{ray:?}");
                rays += 1;
            }
        }
    }
    assert!(rays > 90_000, "{rays}");
}

#[test]
fn nothing_is_hit_in_an_empty_mesh() {
    let mesh = Triangles::new(&Mesh::default(), 1.0);
    let ray = Ray { origin: Point3::origin(), dir: Vector3::z() };
    assert!(mesh.hit(&ray, f64::INFINITY).is_none() && !mesh.occludes(&ray, f64::INFINITY));
}
