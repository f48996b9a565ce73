use nelu3d::reconstruct::refine::thin_plate::ThinPlatePrior;
use nelu3d_field::plate::reference::{product, solve};
use nelu3d_field::plate::{PlateStop, sweep};

const EXACT: PlateStop = PlateStop { reduction: 1e-4, settled: 0.0, iterations: 3000 };

fn plane_with_a_hole() -> (ThinPlatePrior, Vec<f32>) {
    let (w, h) = (40, 30);
    let ring = |x: usize, y: usize| x == 0 || x == w - 1 || y == 0 || y == h - 1;
    let hole = |x: usize, y: usize| x > 15 && x < 18 && y > 10;
    let active: Vec<bool> = (0..w * h).map(|i| !ring(i % w, i / w) && !hole(i % w, i / w)).collect();
    let plane = |i: usize| 3.0 + 0.2 * (i % w) as f32 - 0.1 * (i / w) as f32;
    let x = (0..w * h).map(|i| if active[i] { plane(i) } else { 0.0 }).collect();
    (ThinPlatePrior::new(w, h, active), x)
}

/// Returns DᵀWD x.
fn roughness(p: &ThinPlatePrior, x: &[f32]) -> Vec<f64> {
    let none = vec![0.0; x.len()];
    product(&p.system(&none, &none), &x.iter().map(|v| f64::from(*v)).collect::<Vec<_>>(), false)
}

#[test]
fn planes_cost_nothing() {
    let (mut p, x) = plane_with_a_hole();
    p.reweight(&x, 0.5, 10.0, 2);
    assert!(roughness(&p, &x).iter().all(|v| v.abs() < 1e-4));
}

/// The solution for sparse noise-free data on a plane is the plane, whether tiles or all pixels are solved together.
#[test]
fn a_plane_is_recovered_from_few_points() {
    let (mut p, x) = plane_with_a_hole();
    p.reweight(&x, 1.0, 10.0, 2);
    let h: Vec<f32> = (0..x.len()).map(|i| if i % 7 == 0 && p.active[i] { 1.0 } else { 0.0 }).collect();
    // From a surface of zeros the gradient of ½ Σ h (y − x)² is −h x.
    let g: Vec<f32> = h.iter().zip(&x).map(|(h, x)| -h * x).collect();
    let mut y = vec![0.0; x.len()];
    sweep(&p.system(&h, &g), &mut y, 0, 1e9, EXACT);
    let (change, iterations) = solve(&p.system(&h, &g), &vec![0.0; x.len()], EXACT);
    assert!(iterations < EXACT.iterations, "{iterations} iterations");
    for i in 0..x.len() {
        assert!((y[i] - x[i]).abs() < 0.02 && (change[i] as f32 - x[i]).abs() < 0.02, "{i}: {} {}", y[i], x[i]);
    }
}
