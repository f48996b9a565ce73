use nalgebra::{Point3, Vector3};
use nelu3d::reconstruct::neural::bounds::Bounds;
use nelu3d::reconstruct::neural::config::{occupancy_config, surface_config};
use nelu3d::reconstruct::neural::march::{March, step_mm};
use nelu3d::reconstruct::neural::start::Start;
use nelu3d::reconstruct::neural::view::{mean_place, render};
use nelu3d_field::occupancy::OccupancyGrid;

/// The mean place of the weight in an interval is that of fine steps, and of a sharp surface where its distance is zero.
#[test]
fn the_mean_place_is_that_of_fine_steps() {
    let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
    for (a, b) in [(0.4, -0.3), (3.0, -1.0), (2.0, 1.0), (-1.0, -4.0), (12.0, -5.0), (0.5, 0.4)] {
        let n = 20_000;
        let at = |i: usize| a + (b - a) * i as f64 / n as f64;
        let weight = |i: usize| logistic(at(i)) - logistic(at(i + 1));
        let sum: f64 = (0..n).map(|i| weight(i) * (i as f64 + 0.5) / n as f64).sum();
        let expected = sum / (logistic(a) - logistic(b));
        assert!((mean_place(a, b) - expected).abs() < 1e-6, "{a} to {b}: {} for {expected}", mean_place(a, b));
    }
    assert!((mean_place(900.0, -300.0) - 0.75).abs() < 1e-3);
    assert_eq!(mean_place(0.2, 0.2), 0.5);
    assert_eq!(mean_place(80.0, 40.0), 0.5, "nothing is there");
}

/// A surface that is sharper than the steps of the march is rendered where its distance is zero, not in the middle of a
/// step.
#[test]
fn a_sharp_surface_is_between_the_steps() {
    let mut config = surface_config(Default::default(), 100);
    config.field.encoding.log2_hashmap_size = 12;
    // 1,100 a unit: a twentieth of the cube's side is 165 of its widths.
    config.sharpness = 0.7;
    let surface = Start::Sphere.surface(config, 3);
    let bounds = Bounds { center: Point3::new(0.0, 0.0, 600.0), unit_mm: 100.0 };
    let grid = OccupancyGrid::new(occupancy_config(100), |_| true);
    let marches: Vec<March> = (0..400)
        .map(|i| {
            let [x, y] = [i % 20, i / 20].map(|v| 0.0055 * (f64::from(v) - 9.5));
            let dir = Vector3::new(x, y, 1.0).normalize();
            March { origin: Point3::origin(), dir, range: [0.0, 1e4], offset: 0.5 }
        })
        .collect();
    let seen = render(&surface, &bounds, &grid, &marches);
    let distance = |march: &March, t: f64| {
        let mut f = [0.0];
        surface.field().query(&[bounds.to_cube(&(march.origin + march.dir * t))], &mut f);
        f64::from(f[0])
    };
    let (mut off, step) = (Vec::new(), step_mm(&bounds));
    for (march, t) in marches.iter().zip(&seen.t) {
        let t = f64::from(*t);
        // Where the body ends a ray may graze it.
        if !t.is_finite() || distance(march, t - 2.0 * step) < 0.0 || distance(march, t + 2.0 * step) > 0.0 {
            continue;
        }
        let (mut near, mut far) = (t - 2.0 * step, t + 2.0 * step);
        for _ in 0..30 {
            let middle = 0.5 * (near + far);
            if distance(march, middle) > 0.0 { near = middle } else { far = middle }
        }
        off.push((t - near).abs() / step);
    }
    assert!(off.len() > 250, "{} rays meet the body", off.len());
    off.sort_by(f64::total_cmp);
    let (median, ninth) = (off[off.len() / 2], off[off.len() * 9 / 10]);
    assert!(median < 0.02 && ninth < 0.08, "off by {median} of a step in the median, {ninth} of the worst tenth");
}
