mod roots;
mod sphere;
mod vase;

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Ray;
use nelu3d_sim::scene::ShapeHit;
use nelu3d_sim::scene::shape::{Cuboid, Cylinder, Rectangle, Shape, Sphere, Step, Torus, Vase};
use nelu3d_sim::scene::triangles::Triangles;
use nelu3d_sim::spec::{AxisSpec, DeformationSpec};

use super::icosphere::icosphere;

fn all() -> Vec<Shape> {
    vec![
        Shape::Rectangle(Rectangle::new([-30.0, -20.0], [10.0, 25.0])),
        Shape::Sphere(Sphere { radius: 30.0 }),
        Shape::Step(Step { half_width: 30.0, half_height: 20.0, jump: 12.0 }),
        Shape::Step(Step { half_width: 30.0, half_height: 20.0, jump: -12.0 }),
        Shape::Vase(Vase::new(&[[0.0, 20.0], [15.0, 9.0], [30.0, 22.0], [50.0, 12.0]]).unwrap()),
        Shape::Cuboid(Cuboid { half: [30.0, 20.0, 10.0] }),
        Shape::Cylinder(Cylinder { radius: 20.0, half_height: 30.0 }),
        Shape::Torus(Torus { major: 15.0, minor: 8.0 }),
        Shape::Triangles(Arc::new(Triangles::new(&icosphere(30.0, 4), 1.0))),
        Shape::Rectangle(Rectangle::new([-30.0, -20.0], [30.0, 25.0]))
            .deformed(&DeformationSpec::Bend { curvature_per_mm: 0.02, axis: AxisSpec::Y }),
        Shape::Cylinder(Cylinder { radius: 12.0, half_height: 30.0 })
            .deformed(&DeformationSpec::Twist { rate_per_mm: 0.01, axis: AxisSpec::Y }),
    ]
}

/// Without the thousands of numbers of a mesh.
fn name(shape: &Shape) -> String {
    format!("{shape:?}").chars().take(80).collect()
}

fn point(v: [f32; 3]) -> Vector3<f64> {
    Vector3::from(v.map(f64::from))
}

/// Rays aimed from outside at the middle of every triangle hit the surface there, or something in front of it; and
/// what they hit agrees with the triangle.
#[test]
fn meshes_lie_on_the_surfaces_that_rays_hit() {
    for shape in all() {
        let mesh = shape.mesh();
        assert_eq!(mesh.vertices.len(), mesh.normals.len());
        let mut exact = 0;
        let step = (mesh.faces.len() / 500).max(1);
        for face in mesh.faces.iter().step_by(step) {
            let [a, b, c] = face.map(|i| point(mesh.vertices[i as usize]));
            let middle = (a + b + c) / 3.0;
            let cross = (b - a).cross(&(c - a));
            if cross.norm() < 1e-9 {
                continue;
            }
            let outward = cross.normalize();
            for n in face.map(|i| point(mesh.normals[i as usize])) {
                assert!(n.dot(&outward) > 0.7, "{}: normal {n} against {outward}", name(&shape));
            }
            let ray = Ray { origin: Point3::from(middle + outward * 200.0), dir: -outward };
            let ShapeHit { t, normal, .. } =
                shape.hit(&ray, f64::INFINITY).unwrap_or_else(|| panic!("{} missed", name(&shape)));
            assert!(t < 200.1, "{}: {t}", name(&shape));
            assert!((normal.norm() - 1.0).abs() < 1e-9);
            if t > 199.9 {
                exact += 1;
                assert!(normal.dot(&outward).abs() > 0.99, "{}", name(&shape));
            }
        }
        assert!(exact * 2 > mesh.faces.len() / step, "{}: {exact}", name(&shape));
    }
}

#[test]
fn a_hit_beyond_the_limit_or_behind_is_none() {
    for shape in all() {
        let ray = Ray { origin: Point3::new(-5.0, -5.0, -100.0), dir: Vector3::z() };
        let t = shape.hit(&ray, f64::INFINITY).unwrap().t;
        assert!(shape.hit(&ray, t - 1e-6).is_none() && shape.hit(&ray, t + 1e-6).is_some());
        let away = Ray { dir: -Vector3::z(), ..ray };
        assert!(shape.hit(&away, f64::INFINITY).is_none());
    }
}
