use nalgebra::{Point3, Vector3};
use nelu3d::color_field::frame::FieldFrame;

fn frame() -> FieldFrame {
    let mut f = FieldFrame::around(Point3::new(210.0, -20.0, 10.0), Point3::new(0.0, 0.0, 700.0), Vector3::x());
    for c in 0..8 {
        let s = |bit: i32, r: f64| if c >> bit & 1 == 1 { r } else { -r };
        f.enclose(&Point3::new(s(0, 100.0), s(1, 80.0), 700.0 + s(2, 90.0)));
    }
    f
}

#[test]
fn light_rays_keep_their_a_and_b() {
    let f = frame();
    let o = f.center().unwrap();
    let x = Point3::new(30.0, -20.0, 650.0);
    let far = o + (x - o) * 1.2;
    let (p, q) = (f.to_abw(&x).unwrap(), f.to_abw(&far).unwrap());
    assert!((p[0] - q[0]).abs() < 1e-9 && (p[1] - q[1]).abs() < 1e-9 && q[2] > p[2] + 1.0);
}

#[test]
fn unit_coordinates_round_trip_and_differentiate() {
    let f = frame();
    let dir = Vector3::new(0.05, -0.03, 1.0).normalize();
    let ray = f.along_ray(&dir);
    for t in [620.0, 700.0, 780.0] {
        let x = Point3::from(dir * t);
        let q = f.to_unit(&x).unwrap();
        let m = ray.at(t);
        let y = std::array::from_fn(|i| ray.center[i] + t * ray.dir[i]);
        assert_eq!(f.projective().to_unit(y), m.q);
        let inv_z = (1.0 / (t * dir.z)) as f32;
        let by_depth = ray.by_inverse_depth(inv_z - 2e-6, 1e-6, dir.z as f32).at(2.0);
        assert!((0..3).all(|i| (by_depth.q[i] - m.q[i]).abs() < 1e-5), "{by_depth:?} {m:?}");
        let back = f.from_unit(q.map(f64::from));
        assert!((back - x).norm() < 1e-2, "{back} {x}");
        let (hi, lo) = (ray.at(t + 0.5), ray.at(t - 0.5));
        for i in 0..3 {
            assert!((q[i] - m.q[i]).abs() < 1e-5);
            assert!((hi.q[i] - lo.q[i] - m.dq[i]).abs() < 1e-4 * m.dq[i].abs().max(1e-3), "axis {i}");
        }
    }
}
