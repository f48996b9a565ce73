use super::*;
use crate::check::uniform_f32;

#[test]
fn spline_weights_sum_to_one_and_their_slopes_to_zero() {
    for i in 0..=10 {
        let f = i as f32 / 10.0;
        assert!((weights(f).iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(slopes(f).iter().sum::<f32>().abs() < 1e-6);
        assert!(weights(f).iter().zip(weights_by_product(f)).all(|(a, b)| (a - b).abs() <= f32::EPSILON));
        let h = 1e-5;
        let (hi, lo) = (weights(f64::from(f) + h), weights(f64::from(f) - h));
        for j in 0..4 {
            assert!(((hi[j] - lo[j]) / (2.0 * h) - f64::from(slopes(f)[j])).abs() < 1e-6);
        }
    }
}

#[test]
fn the_evaluator_agrees_with_the_plain_evaluation() {
    for k in 1..9 {
        let cells = [7, 5, 4];
        let nodes = uniform_f32(k as u64, cells.iter().map(|c| c + 3).product::<usize>() * k, -1.0, 1.0);
        let lattice = Lattice { cells, k, nodes: &nodes };
        lattice.check();
        let evaluator = LatticeEvaluator::new(lattice);
        let (mut a, mut b) = (vec![0.0; k], vec![0.0; k]);
        let (mut da, mut db) = (vec![0.0; k], vec![0.0; k]);
        for s in 0..50 {
            let q = [0.3 + 0.7 * (s as f32 * 0.37).sin(), (s as f32 * 0.11) % 1.0, 1.02 - s as f32 * 0.02];
            let dq = [0.2, -0.5, 0.1 * s as f32];
            lattice.eval_along(q, dq, &mut a, &mut da);
            evaluator.eval_along(q, dq, &mut b, &mut db);
            let scale = da.iter().fold(1.0f32, |m, d| m.max(d.abs()));
            for c in 0..k {
                assert!((a[c] - b[c]).abs() < 1e-5 && (da[c] - db[c]).abs() < 1e-5 * scale, "{k} {s}");
            }
            evaluator.eval(q, &mut b);
            assert!((0..k).all(|c| (a[c] - b[c]).abs() < 1e-5), "{k} {s}");
            // Both plain forms sum the same products in the same order.
            lattice.eval(q, &mut b);
            assert_eq!(a, b, "{k} {s}");
        }
    }
}

#[test]
fn homogeneous_coordinates_are_the_unit_coordinates() {
    let frame = ProjectiveFrame { kappa: 0.2, lo: [-0.3, 0.1, -0.2], scale: [0.7, 1.1, 0.9] };
    for y in [[0.4, -0.3, 0.2], [0.0, 0.9, -0.7]] {
        let h = frame.homogeneous(y, 1.0);
        let q = frame.to_unit(y);
        assert!((0..3).all(|i| (h[i] / h[3] - f64::from(q[i])).abs() < 1e-7), "{h:?} {q:?}");
    }
    // A point is its base and its direction.
    let [a, b] = [frame.homogeneous([0.1, 0.2, 0.3], 1.0), frame.homogeneous([0.3, -0.5, -0.1], 0.0)];
    let sum = frame.homogeneous([0.4, -0.3, 0.2], 1.0);
    assert!((0..4).all(|i| (a[i] + b[i] - sum[i]).abs() < 1e-12));
}
