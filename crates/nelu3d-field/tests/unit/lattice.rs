use crate::check::uniform_f32;
use nelu3d_field::lattice::{
    CurvePoint, Lattice, LatticeEvaluator, ProjectiveFrame, ProjectiveLine, slopes, weights, weights_by_product,
};

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
    for k in (1..9).chain([10, 16, 20, 31]) {
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

#[test]
fn jets_are_value_slope_and_bend_along_a_curve() {
    for k in (1..9).chain([10, 16, 20, 31]) {
        let cells = [7, 5, 4];
        let nodes = uniform_f32(k as u64, cells.iter().map(|c| c + 3).product::<usize>() * k, -1.0, 1.0);
        let lattice = Lattice { cells, k, nodes: &nodes };
        // Lines that stay in one cell for a while, and some whose ends are outside.
        let lines: Vec<ProjectiveLine> = (0..37)
            .map(|i| ProjectiveLine {
                origin: [0.05 + 0.03 * i as f32, (0.21 * i as f32) % 1.0, 1.02 - 0.02 * i as f32],
                slope: [0.11, -0.06, 0.05 - 0.002 * i as f32],
                bend: 0.2,
            })
            .collect();
        let points: Vec<CurvePoint> = lines.iter().map(|line| line.at(0.1)).collect();
        let mut jets = vec![0.0; points.len() * 3 * k];
        lattice.eval_jets(&points, &mut jets);
        let mut plain = vec![0.0; 3 * k];
        let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
        for (i, jet) in jets.chunks_exact(3 * k).enumerate() {
            lattice.eval_jet(&points[i], &mut plain);
            assert!(jet.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-4), "{k} {i}: {jet:?} {plain:?}");
            let inside = points[i].q.iter().all(|q| (0.0..1.0).contains(q));
            if !inside {
                continue;
            }
            lattice.eval_along(points[i].q, points[i].dq, &mut c, &mut d);
            assert!((0..k).all(|j| (jet[j] - c[j]).abs() < 1e-5 && (jet[k + j] - d[j]).abs() < 1e-4), "{k} {i}");
            // The bend is the slope's change along the curve; a cubic's is not constant.
            let h = 0.02;
            let slope = |s: f32| {
                let (mut c, mut d, p) = (vec![0.0; k], vec![0.0; k], lines[i].at(s));
                lattice.eval_along(p.q, p.dq, &mut c, &mut d);
                d
            };
            let (hi, lo) = (slope(0.1 + h), slope(0.1 - h));
            let around = |j: usize| (hi[j] - lo[j]) / (2.0 * h);
            let largest = (0..k).map(around).fold(1.0f32, |m, v| m.max(v.abs()));
            assert!((0..k).all(|j| (jet[2 * k + j] - around(j)).abs() < 0.1 * largest), "{k} {i}");
        }
    }
}

#[test]
fn a_projective_line_is_its_homogeneous_coordinates() {
    let (base, step) = ([0.3, 0.5, 0.2, 1.1], [0.02, -0.01, 0.03, 0.05]);
    let line = ProjectiveLine::new(base, step);
    for s in [-0.5, 0.0, 0.7] {
        let at = |s: f64| -> [f64; 3] { std::array::from_fn(|i| (base[i] + s * step[i]) / (base[3] + s * step[3])) };
        let (p, here, h) = (line.at(s as f32), at(s), 1e-3);
        let (hi, lo) = (at(s + h), at(s - h));
        for i in 0..3 {
            assert!((f64::from(p.q[i]) - here[i]).abs() < 1e-6);
            assert!((f64::from(p.dq[i]) - (hi[i] - lo[i]) / (2.0 * h)).abs() < 1e-6);
            assert!((f64::from(p.ddq[i]) - (hi[i] - 2.0 * here[i] + lo[i]) / (h * h)).abs() < 1e-5);
        }
    }
}
