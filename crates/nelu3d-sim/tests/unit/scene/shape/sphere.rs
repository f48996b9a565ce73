use nalgebra::{Point3, Vector3};
use nelu3d_scan::Ray;
use nelu3d_sim::scene::shape::{Shape, Sphere};

#[test]
fn hits_are_at_the_radius_and_first() {
    let sphere = Shape::Sphere(Sphere { radius: 3.0 });
    for i in 0..100 {
        let x = -2.99 + 0.0598 * f64::from(i);
        let ray = Ray { origin: Point3::new(x, 0.0, -1000.0), dir: Vector3::z() };
        let t = sphere.hit(&ray, f64::INFINITY).unwrap().t;
        assert!((t - (1000.0 - (9.0 - x * x).sqrt())).abs() < 1e-9);
    }
    let beside = Ray { origin: Point3::new(3.0001, 0.0, -10.0), dir: Vector3::z() };
    assert!(sphere.hit(&beside, f64::INFINITY).is_none());
}
