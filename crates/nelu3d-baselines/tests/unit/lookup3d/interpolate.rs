use nelu3d_baselines::lookup3d::interpolate::{lagrange, vertex};

#[test]
fn lagrange_reproduces_cubics() {
    let knots = [0.0, 1.0, -0.8, 2.3];
    let f = |t: f32| 1.0 - 2.0 * t + 0.5 * t * t + 0.3 * t * t * t;
    let d = |t: f32| -2.0 + t + 0.9 * t * t;
    for t in [0.0, 0.2, 0.7, 1.0] {
        let (value, slope) = lagrange(&knots, t);
        let sum = |w: [f32; 4]| w.iter().zip(knots).map(|(w, x)| w * f(x)).sum::<f32>();
        assert!((sum(value) - f(t)).abs() < 1e-5 && (sum(slope) - d(t)).abs() < 1e-5);
    }
}

#[test]
fn the_vertex_of_a_parabola_is_found_over_uneven_steps() {
    let f = |x: f32| 0.5 + 3.0 * (x - 1.2) * (x - 1.2);
    let (x, y) = vertex([0.0, 1.0, 1.7], [f(0.0), f(1.0), f(1.7)]);
    assert!((x - 1.2).abs() < 1e-5 && (y - 0.5).abs() < 1e-5);
    assert_eq!(vertex([0.0, 1.0, 2.0], [1.0, 1.0, 1.0]), (1.0, 1.0));
}
