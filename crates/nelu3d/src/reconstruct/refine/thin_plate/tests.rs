use super::operator::BLOCK;
use super::{StopCriterion, ThinPlatePrior};

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
fn roughness(p: &ThinPlatePrior, x: &[f32]) -> Vec<f32> {
    let mut y = vec![0.0; x.len()];
    let h = vec![0.0; x.len()];
    let mut scratch = p.scratch();
    for (block, y) in y.chunks_mut(BLOCK * p.width).enumerate() {
        p.apply_block(block, &h, x, &mut scratch, y);
    }
    y
}

#[test]
fn planes_cost_nothing() {
    let (mut p, x) = plane_with_a_hole();
    p.reweight(&x, 0.5, 10.0, 2);
    assert!(roughness(&p, &x).iter().all(|v| v.abs() < 1e-3));
}

/// The solution for sparse noise-free data on a plane is the plane.
#[test]
fn a_plane_is_recovered_from_few_points() {
    let (mut p, x) = plane_with_a_hole();
    p.reweight(&x, 1.0, 10.0, 2);
    let h: Vec<f32> = (0..x.len()).map(|i| if i % 7 == 0 && p.active[i] { 1.0 } else { 0.0 }).collect();
    let b: Vec<f32> = h.iter().zip(&x).map(|(h, x)| h * x).collect();
    let mut y = vec![0.0; x.len()];
    let n = p.solve(&h, &b, &mut y, StopCriterion { reduction: 1e-4, iterations: 3000 });
    assert!(n < 3000, "{n} iterations");
    for i in 0..x.len() {
        if p.active[i] {
            assert!((y[i] - x[i]).abs() < 0.02, "{i}: {} {}", y[i], x[i]);
        } else {
            assert_eq!(y[i], 0.0);
        }
    }
}

/// The operator is symmetric: ⟨Ax, y⟩ = ⟨x, Ay⟩, with holes and uneven weights.
#[test]
fn the_operator_is_symmetric() {
    let (mut p, x) = plane_with_a_hole();
    p.reweight(&x.iter().map(|v| (v * 7.3).sin()).collect::<Vec<_>>(), 0.3, 1.0, 2);
    let on =
        |f: &dyn Fn(usize) -> f32| -> Vec<f32> { (0..x.len()).map(|i| if p.active[i] { f(i) } else { 0.0 }).collect() };
    let (u, v) = (on(&|i| (i as f32 * 0.7).sin()), on(&|i| (i as f32 * 1.3).cos()));
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
    let (a, b) = (dot(&v, &roughness(&p, &u)), dot(&u, &roughness(&p, &v)));
    assert!((a - b).abs() < 1e-3 * a.abs().max(1.0), "{a} {b}");
}
