mod defocus;
mod light_shift;
mod lines;
mod penalty;

use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::fit::normal::Normal;
use nelu3d::color_field::fit::penalty::Penalty;
use nelu3d::color_field::fit::{LeastSquares, Smoothness, dots};
use nelu3d::color_field::grid::Grid;
use nelu3d::progress::Progress;
use nelu3d_field::lattice;

fn fit(grid: &mut Grid, bins: &Bins, smooth: &Smoothness, iterations: usize, progress: &Progress) {
    LeastSquares::new(grid.cells, bins).solve_once(grid, smooth, iterations, progress);
}

/// Returns a generator of numbers in [0, 1) with a fixed seed.
fn unit(seed: u64) -> impl FnMut() -> f32 {
    let mut rng = seed;
    move || {
        rng = rng.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (rng >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Returns the variances of a bin's samples along a, b and w, in squared cells.
fn spread_in_cells(spread: [f32; 2], cells: [usize; 3], bins: [usize; 3]) -> [f64; 3] {
    let of = |i: usize| f64::from(spread[i]) * (cells[i] as f64 / bins[i] as f64).powi(2);
    [of(0), of(1), 0.0]
}

/// Returns the cell at `q` and, per axis, the weights of its nodes in w + ½ v w″; w″ is the difference of slopes,
/// which are quadratic.
fn blurred(cells: [usize; 3], q: [f32; 3], spread: [f64; 3]) -> ([usize; 3], [[f64; 4]; 3]) {
    let (cell, f) = lattice::locate(cells, q);
    let weights = std::array::from_fn(|axis| {
        let (weights, before, after) =
            (lattice::weights(f[axis]), lattice::slopes(f[axis] - 0.5), lattice::slopes(f[axis] + 0.5));
        std::array::from_fn(|j| f64::from(weights[j]) + 0.5 * spread[axis] * f64::from(after[j] - before[j]))
    });
    (cell, weights)
}

/// Returns the sum of a channel's nodes from `cell` on, weighted.
fn sum_of_nodes(grid: &Grid, cell: [usize; 3], weights: &[[f64; 4]; 3], c: usize) -> f64 {
    let [na, _, nw] = grid.nodes();
    let mut sum = 0.0;
    for i in 0..64 {
        let [a, b, w] = [i % 4, i / 4 % 4, i / 16];
        let node = ((cell[1] + b) * na + cell[0] + a) * nw + cell[2] + w;
        sum += weights[0][a] * weights[1][b] * weights[2][w] * f64::from(grid.coeffs[node * grid.k + c]);
    }
    sum
}

/// Returns the scalar product.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    dots(a, b, 1)[0]
}

/// A smoothness that leaves samples of `k` channels as they are.
fn weak(k: usize) -> Smoothness {
    Smoothness { across: 1e-4, along: 1e-4, slope_along: 0.0, of_channels: vec![[1.0; 3]; k], defocus: None }
}

/// Samples of a steep wave, many to a bin, give the wave and not the blurred one that the bins' means are.
#[test]
fn bins_with_many_samples_do_not_blur() {
    let wave = |a: f32| 0.5 + 0.5 * (std::f32::consts::TAU * a * 5.0).cos();
    let mut bins = Bins::new([40, 4, 2], 1);
    let mut unit = unit(7);
    for _ in 0..40_000 {
        let q = [unit(), unit(), unit()];
        bins.add(q, &[wave(q[0])], &[1.0]);
    }
    let mut grid = Grid::new([40, 4, 1], 1);
    fit(&mut grid, &bins, &weak(1), 100, &Progress::none());
    let mut v = [0.0];
    // Its part of the wave, over the middle half.
    let (mut product, mut square) = (0.0, 0.0);
    for i in 0..400 {
        let a = 0.25 + 0.5 * i as f32 / 400.0;
        grid.eval([a, 0.5, 0.5], &mut v);
        product += (v[0] - 0.5) * (wave(a) - 0.5);
        square += (wave(a) - 0.5).powi(2);
    }
    let amplitude = product / square;
    // Eight cells a period: a mean over a cell has 0.975 of the amplitude.
    assert!((amplitude - 1.0).abs() < 0.01, "{amplitude}");
}

/// A fit to exact samples of a smooth function reproduces it, and its directional derivative, everywhere.
#[test]
fn fits_a_smooth_function() {
    let expected = |q: [f32; 3], c: usize| (7.0 * q[0] + c as f32).sin() * (1.0 + 0.3 * q[2]) + q[1] * q[1];
    for k in [1, 3, 7] {
        let mut bins = Bins::new([80, 60, 12], k);
        let mut unit = unit(12345);
        for _ in 0..120_000 {
            let q = [unit(), unit(), unit()];
            let v: Vec<f32> = (0..k).map(|c| expected(q, c)).collect();
            bins.add(q, &v, &vec![1.0; k]);
        }
        let mut grid = Grid::new([40, 30, 4], k);
        fit(&mut grid, &bins, &weak(k), 60, &Progress::none());
        let (mut v, mut d) = (vec![0.0; k], vec![0.0; k]);
        for _ in 0..500 {
            let q = [0.05 + 0.9 * unit(), 0.05 + 0.9 * unit(), 0.05 + 0.9 * unit()];
            grid.eval_along(q, [1.0, 0.0, 0.5], &mut v, &mut d);
            for c in 0..k {
                let slope = 7.0 * (7.0 * q[0] + c as f32).cos() * (1.0 + 0.3 * q[2])
                    + 0.5 * 0.3 * (7.0 * q[0] + c as f32).sin();
                assert!((v[c] - expected(q, c)).abs() < 5e-3, "{} {}", v[c], expected(q, c));
                assert!((d[c] - slope).abs() < 0.2, "{} {slope}", d[c]);
            }
            let mut again = vec![0.0; k];
            grid.eval(q, &mut again);
            assert!(again.iter().zip(&v).all(|(a, b)| (a - b).abs() < 1e-5));
        }
    }
}

/// The operator agrees with its definition, xᵀ(BᵀΩB + Σ λ DᵀD)y through `Grid::eval` and differences written out,
/// for lengths of runs that the compiler knows and for one that it does not, over more than two stripes of rows.
#[test]
fn the_operator_agrees_with_its_definition() {
    for k in [1, 3, 7] {
        let mut unit = unit(99);
        let mut bins = Bins::new([9, 70, 5], k);
        for _ in 0..3000 {
            let q = [unit(), unit(), unit()];
            let v: Vec<f32> = (0..k).map(|_| unit()).collect();
            let w: Vec<f32> = (0..k).map(|_| 0.1 + unit()).collect();
            bins.add(q, &v, &w);
        }
        let cells = [6, 50, 3];
        let mut random = || {
            let mut g = Grid::new(cells, k);
            g.coeffs.iter_mut().for_each(|c| *c = unit() - 0.5);
            g
        };
        let (x, y) = (random(), random());
        let normal = Normal::new(x.cells, &bins, 0..k);
        let smooth =
            Smoothness { across: 0.3, along: 0.7, slope_along: 0.2, of_channels: vec![[1.0; 3]; k], defocus: None };
        let lambda: Vec<f32> = (0..k).map(|c| 1.0 + c as f32).collect();
        let mut ax = vec![0.0; x.coeffs.len()];
        Penalty::new(&x, &smooth, &lambda).apply(&x.coeffs, &mut ax);
        let (rhs, mut diag) = (normal.right_side(&bins), normal.diagonal());
        let penalty = dot(&y.coeffs, &ax);
        normal.apply(&x.coeffs, &mut ax);
        let samples = dot(&y.coeffs, &ax) - penalty;

        let (mut expected, mut expected_rhs, mut trace) = (0.0f64, 0.0f64, 0.0f64);
        for row in 0..bins.n_rows() {
            bins.for_each_in_row(row, |s| {
                let (cell, weights) = blurred(cells, s.q, spread_in_cells(s.spread, cells, bins.counts()));
                for c in 0..k {
                    let [vx, vy] = [&x, &y].map(|grid| sum_of_nodes(grid, cell, &weights, c));
                    expected += f64::from(s.omegas[c]) * vx * vy;
                    expected_rhs += f64::from(s.moments[c]) * vy;
                }
                let squares = weights.map(|w| w.iter().map(|w| w * w).sum::<f64>());
                trace += squares.iter().product::<f64>() * f64::from(s.omegas.iter().sum::<f32>());
            });
        }
        let close = |a: f64, b: f64| (a - b).abs() < 1e-3 * b.abs().max(1.0);
        assert!(close(samples, expected), "k {k}: {samples} {expected}");
        assert!(close(dot(&y.coeffs, &rhs), expected_rhs));
        assert!(close(diag.drain(..).map(f64::from).sum(), trace));

        let [na, nb, nw] = x.nodes();
        let at = |g: &Grid, [a, b, w]: [usize; 3], c: usize| g.coeffs[((b * na + a) * nw + w) * k + c];
        let mut expected = 0.0f64;
        for (axis, strength) in [smooth.across, smooth.across, smooth.along].into_iter().enumerate() {
            for b in 0..nb {
                for a in 0..na {
                    for w in 0..nw {
                        let here = [a, b, w];
                        if here[axis] == 0 || here[axis] + 1 == [na, nb, nw][axis] {
                            continue;
                        }
                        let (mut lo, mut hi) = (here, here);
                        lo[axis] -= 1;
                        hi[axis] += 1;
                        for c in 0..k {
                            let d = |g: &Grid| at(g, lo, c) - 2.0 * at(g, here, c) + at(g, hi, c);
                            expected += f64::from(lambda[c] * strength * d(&x) * d(&y));
                        }
                    }
                }
            }
        }
        let (xg, yg) = (&x, &y);
        for (i, (x, y)) in x.coeffs.iter().zip(&y.coeffs).enumerate().filter(|(i, _)| i / k % nw + 1 < nw) {
            let d = |g: &Grid, v: f32| g.coeffs[i + k] - v;
            expected += f64::from(lambda[i % k] * smooth.slope_along * d(xg, *x) * d(yg, *y));
        }
        assert!(close(penalty, expected), "k {k}: {penalty} {expected}");
    }
}
