use nelu3d_scan::pose::Bend;

#[test]
fn a_quadratic_is_its_principal_curvatures() {
    let center = [12.0, -7.0];
    for quadratic in [[2e-4, 0.0, 0.0], [0.0, 0.0, -1e-4], [1e-4, 2e-4, 1e-4], [-3e-5, 1e-4, 8e-5]] {
        let bend = Bend::from_quadratic(center, quadratic);
        for (x, y) in [(30.0, 5.0), (-80.0, 40.0), (0.0, -60.0)] {
            let expected = quadratic[0] * x * x + quadratic[1] * x * y + quadratic[2] * y * y;
            assert!((bend.height([center[0] + x, center[1] + y]) - expected).abs() < 1e-12);
        }
    }
}

#[test]
fn a_cylinder_keeps_the_lengths_of_its_print() {
    let radius = 1500.0;
    let bend = Bend { center_mm: [0.0; 2], curvature_per_mm: [1.0 / radius, 0.0], angle_rad: 0.3 };
    for arc in [-120.0f64, 40.0, 120.0] {
        let (sin, cos) = 0.3f64.sin_cos();
        let on = bend.point([cos * arc - sin * 25.0, sin * arc + cos * 25.0]);
        let (p, q) = (cos * on.x + sin * on.y, cos * on.y - sin * on.x);
        let angle = arc / radius;
        // The height of the arc, and of the parabola over the arc's length: 5 µm apart at 120 mm.
        assert!((p - radius * angle.sin()).abs() < 1e-4 && (q - 25.0).abs() < 1e-9, "{p} {q}");
        assert!((on.z - radius * (1.0 - angle.cos())).abs() < 5e-3);
        let back = bend.printed([on.x, on.y]);
        assert!((cos * back[0] + sin * back[1] - arc).abs() < 1e-3, "{back:?}");
    }
    let [x, y] = Bend { angle_rad: 0.0, ..bend }.sagittas_mm([-120.0, -90.0, 120.0, 90.0]);
    assert!((x - 120.0 * 120.0 / 3000.0).abs() < 1e-9 && y == 0.0);
}
