use nalgebra::{Point3, Vector3};
use nelu3d::reconstruct::neural::bounds::Bounds;

#[test]
fn holds_its_points_and_clips_rays() {
    let points = [Point3::new(-50.0, 10.0, 600.0), Point3::new(70.0, -40.0, 700.0)];
    let b = Bounds::around(points).unwrap();
    assert!((b.side_mm() - 122.4).abs() < 1e-9);
    for p in points {
        let q = b.to_cube(&p);
        assert!(q.iter().all(|q| (0.0..=1.0).contains(q)));
        assert!((b.from_cube(q) - p).norm() < 1e-4);
    }
    let dir = Vector3::new(0.02, 0.01, 1.0).normalize();
    let [near, far] = b.clip(&Point3::origin(), &dir, [0.0, 1e9]);
    for t in [near, far] {
        let q = b.to_cube(&(Point3::origin() + dir * t));
        assert!(q.iter().any(|q| q.abs() < 1e-5 || (q - 1.0).abs() < 1e-5), "{q:?}");
    }
    assert!(near < far);
    let [near, far] = b.clip(&Point3::origin(), &Vector3::x(), [0.0, 1e9]);
    assert!(near > far);
    let [near, far] = b.clip(&Point3::new(10.0, -15.0, 0.0), &Vector3::z(), [0.0, 1e9]);
    assert!(near < far && near > 500.0);
    assert!(Bounds::around([]).is_none() && Bounds::around([Point3::origin()]).is_none());
}
