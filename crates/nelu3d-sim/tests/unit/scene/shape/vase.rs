use nalgebra::Point3;
use nelu3d_scan::Ray;
use nelu3d_sim::scene::ShapeHit;
use nelu3d_sim::scene::shape::{Shape, Vase};

fn vase() -> Vase {
    Vase::new(&[[0.0, 20.0], [15.0, 9.0], [30.0, 22.0], [50.0, 12.0]]).unwrap()
}

#[test]
fn the_profile_passes_its_knots_smoothly() {
    let v = vase();
    for (h, r) in [(0.0, 20.0), (15.0, 9.0), (30.0, 22.0), (50.0, 12.0)] {
        assert!((v.square(h).0.sqrt() - r).abs() < 1e-9);
    }
    for h in [15.0, 30.0] {
        assert!((v.square(h - 1e-9).1 - v.square(h + 1e-9).1).abs() < 1e-6);
    }
}

/// Against a walk in tiny steps along many rays from all around, whose only assumption is inside or outside.
#[test]
fn no_first_intersection_is_missed_or_invented() {
    let v = vase();
    let inside = |p: &Point3<f64>| {
        let h = -p.y;
        (0.0..=50.0).contains(&h) && p.x * p.x + p.z * p.z < v.square(h).0
    };
    let shape = Shape::Vase(v.clone());
    let mut hits = 0;
    for i in 0..2000 {
        // A lattice of origins on a sphere around it and targets near it.
        let (a, b, c) = (f64::from(i) * 2.399, f64::from(i) * 0.7548 % 1.0, f64::from(i) * 0.5698 % 1.0);
        let y = 2.0 * b - 1.0;
        let r = (1.0 - y * y).sqrt();
        let origin = Point3::new(r * a.cos(), y, r * a.sin()) * 500.0;
        let target = Point3::new(30.0 * (c * 40.0).sin(), -60.0 * c + 5.0, 25.0 * (b * 50.0).cos());
        let ray = Ray { origin, dir: (target - origin).normalize() };
        let step = 0.02;
        let walked = (20_000..30_000).map(|k| f64::from(k) * step).find(|&t| inside(&ray.at(t)));
        match (shape.hit(&ray, f64::INFINITY), walked) {
            (Some(ShapeHit { t, normal: n, .. }), Some(w)) => {
                hits += 1;
                // The walk may step over a grazed corner, so it may be late, never early.
                assert!(t <= w + 1e-9, "ray {i}: {t} after {w}");
                if t < w - step - 1e-9 {
                    assert!(!inside(&ray.at(t + step)) || n.dot(&ray.dir).abs() < 0.2, "ray {i}: {t}, walked {w}");
                }
                let p = ray.at(t);
                let on_side = (p.x * p.x + p.z * p.z - v.square(-p.y).0).abs() < 1e-8;
                let on_disc = p.y.abs() < 1e-9 || (p.y + 50.0).abs() < 1e-9;
                assert!(on_side || on_disc, "ray {i} ends beside the surface");
            }
            (None, Some(w)) => panic!("ray {i} missed; the walk met the vase at {w}"),
            // The walk may step over a graze.
            (Some(ShapeHit { t, normal: n, .. }), None) => {
                assert!(!inside(&ray.at(t + step)) && n.dot(&ray.dir).abs() < 0.2, "ray {i}")
            }
            (None, None) => {}
        }
    }
    assert!(hits > 500, "{hits}");
}

#[test]
fn profiles_without_a_body_are_refused() {
    for bad in [
        &[[0.0, 5.0]][..],
        &[[0.0, 5.0], [0.0, 6.0]],
        &[[0.0, 5.0], [1.0, 0.0]],
        &[[0.0, 5.0], [1.0, f64::NAN]],
        &[[0.0, 100.0], [1.0, 1.0], [2.0, 1.0], [3.0, 100.0]],
    ] {
        assert!(Vase::new(bad).is_none(), "{bad:?}");
    }
}
