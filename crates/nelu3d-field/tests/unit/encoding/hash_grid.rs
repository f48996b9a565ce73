use crate::check::{assert_close, assert_gradient, uniform, uniform_f32};
use nelu3d_field::encoding::hash_grid::{HashGrid, HashGridConfig, HashGridError, cpu, reference};

fn config<const D: usize>(base: [u32; D], finest: [u32; D], n_features_per_level: usize) -> HashGridConfig<D> {
    // 2^9 entries: the coarse levels are dense, the fine ones hashed.
    HashGridConfig {
        n_levels: 4,
        n_features_per_level,
        log2_hashmap_size: 9,
        base_resolution: base,
        finest_resolution: finest,
    }
}

fn grid3(n_features: usize) -> HashGrid<3> {
    HashGrid::new(&config([5, 4, 3], [40, 30, 3], n_features)).unwrap()
}

fn grid2(n_features: usize) -> HashGrid<2> {
    HashGrid::new(&config([7, 4], [64, 50], n_features)).unwrap()
}

fn points<const D: usize>(seed: u64, n: usize) -> Vec<[f32; D]> {
    let mut points: Vec<[f32; D]> =
        uniform_f32(seed, n * D, 0.0, 1.0).chunks_exact(D).map(|x| x.try_into().unwrap()).collect();
    // Corners and outsiders, as far as there is room.
    for (p, x) in points.iter_mut().zip([0.0, 1.0, -0.5, 1.5]) {
        *p = [x; D];
    }
    points
}

#[test]
fn resolutions_grow_geometrically_per_axis_and_meet_both_ends() {
    let c = HashGridConfig::<3> {
        n_levels: 8,
        n_features_per_level: 2,
        log2_hashmap_size: 19,
        base_resolution: [32, 24, 24],
        finest_resolution: [768, 576, 24],
    };
    let grid = HashGrid::new(&c).unwrap();
    let levels = grid.levels();
    assert_eq!(levels[0].resolution, [32, 24, 24]);
    assert_eq!(levels[7].resolution, [768, 576, 24]);
    for pair in levels.windows(2) {
        assert_eq!(pair[1].resolution[2], 24);
        let growth = pair[1].resolution[0] as f64 / pair[0].resolution[0] as f64;
        assert!((growth - 24f64.powf(1.0 / 7.0)).abs() < 0.02, "{growth}");
    }
    // 17 × 13 × 13 bricks of 8 vertices.
    assert!(levels[0].dense && levels[0].n_entries == (17usize * 13 * 13 * 8).next_multiple_of(16));
    assert!(!levels[7].dense && levels[7].n_entries == 1 << 19);
}

#[test]
fn dense_indices_are_injective() {
    let grid = grid3(1);
    let level = &grid.levels()[0];
    let mut seen = vec![false; level.n_entries];
    for z in 0..=level.resolution[2] {
        for y in 0..=level.resolution[1] {
            for x in 0..=level.resolution[0] {
                assert!(!std::mem::replace(&mut seen[level.index([x, y, z])], true));
            }
        }
    }
}

#[test]
fn bricks_lie_in_lines_and_hashed_ones_spread_evenly() {
    let grid = HashGrid::<3>::new(&config([64; 3], [64; 3], 2)).unwrap();
    let level = &grid.levels()[0];
    assert!(!level.dense);
    let mut hits = vec![0; level.n_entries / 8];
    for brick in 0..32u32.pow(3) {
        let at = [brick % 32, brick / 32 % 32, brick / 1024].map(|b| 2 * b);
        let first = level.index(at);
        assert!(first.is_multiple_of(8));
        for corner in 0..8usize {
            let vertex = std::array::from_fn(|a| at[a] + (corner >> a & 1) as u32);
            assert_eq!(level.index(vertex), first + corner);
        }
        hits[first / 8] += 1;
    }
    // 512 bricks per place on average.
    assert!(hits.iter().all(|&n| (256..1024).contains(&n)), "{hits:?}");
}

#[test]
fn a_dense_level_reproduces_multilinear_functions() {
    let c = HashGridConfig::<3> { n_levels: 1, ..config([5, 4, 3], [5, 4, 3], 1) };
    let grid = HashGrid::new(&c).unwrap();
    let level = &grid.levels()[0];
    let truth = |[x, y, z]: [f64; 3]| 1.0 + 2.0 * x - y + 3.0 * x * y * z;
    let mut table = vec![0.0; grid.n_params()];
    for z in 0..=3u32 {
        for y in 0..=4u32 {
            for x in 0..=5u32 {
                table[level.index([x, y, z])] = truth([x as f64 / 5.0, y as f64 / 4.0, z as f64 / 3.0]);
            }
        }
    }
    for x in uniform(1, 60, 0.0, 1.0).chunks_exact(3).chain([&[1.0, 1.0, 1.0][..]]) {
        let x = x.try_into().unwrap();
        let mut out = [0.0];
        reference::forward(&grid, &table, x, &mut out);
        assert!((out[0] - truth(x)).abs() < 1e-12);
    }
}

#[test]
fn reference_gradients_match_central_differences() {
    fn check<const D: usize>(grid: &HashGrid<D>) {
        let table = uniform(1, grid.n_params(), -1.0, 1.0);
        let d_out = uniform(2, grid.n_features(), -1.0, 1.0);
        for seed in 3..6 {
            let x: [f64; D] = uniform(seed, D, 0.05, 0.95).try_into().unwrap();
            let loss = |table: &[f64], x: [f64; D]| {
                let mut out = vec![0.0; grid.n_features()];
                reference::forward(grid, table, x, &mut out);
                out.iter().zip(&d_out).map(|(a, b)| a * b).sum::<f64>()
            };
            let mut d_table = vec![0.0; table.len()];
            reference::backward(grid, x, &d_out, &mut d_table);
            assert_gradient(&table, &d_table, 1e-3, |t| loss(t, x));

            let mut jacobian = vec![[0.0; D]; grid.n_features()];
            reference::jacobian(grid, &table, x, &mut jacobian);
            let d_x: Vec<f64> = (0..D).map(|a| jacobian.iter().zip(&d_out).map(|(j, d)| j[a] * d).sum()).collect();
            // Steps small enough not to leave the cell.
            assert_gradient(&x, &d_x, 1e-6, |x| loss(&table, x.try_into().unwrap()));

            // A loss of the slopes: Σ d_out · (∂features/∂x · u).
            let u: [f64; D] = uniform(seed + 10, D, -1.0, 1.0).try_into().unwrap();
            let along = |table: &[f64]| {
                let mut jacobian = vec![[0.0; D]; grid.n_features()];
                reference::jacobian(grid, table, x, &mut jacobian);
                let rows = jacobian.iter().zip(&d_out);
                rows.map(|(row, d)| d * row.iter().zip(&u).map(|(j, u)| j * u).sum::<f64>()).sum::<f64>()
            };
            let mut d_table = vec![0.0; table.len()];
            reference::backward_jacobian(grid, x, &d_out, u, &mut d_table);
            assert_gradient(&table, &d_table, 1e-3, along);
        }
    }
    check(&grid3(2));
    check(&grid2(4));
}

#[test]
fn cpu_matches_reference() {
    fn check<const D: usize>(grid: &HashGrid<D>, n: usize) {
        let k = grid.n_features();
        let points: Vec<[f32; D]> = points(1, n);
        let table = uniform_f32(2, grid.n_params(), -1.0, 1.0);
        let d_out = uniform_f32(3, n * k, -1.0, 1.0);

        // 2^D products of values below 1, each with D + 2 roundings.
        let eps = f32::EPSILON * 8.0 * 5.0;
        let (mut fast, mut slow) = (vec![0.0; n * k], vec![0.0; n * k]);
        cpu::forward(grid, &table, &points, &mut fast);
        for (&x, out) in points.iter().zip(slow.chunks_exact_mut(k)) {
            reference::forward(grid, &table, x, out);
        }
        assert_close(&fast, &slow, eps);
        let fast_values = fast;

        for every in [1, 2, 3] {
            let n_slopes = n.div_ceil(every);
            let (mut again, mut fast) = (vec![0.0; n * k], vec![0.0; n_slopes * D * k]);
            cpu::forward_with_jacobian(grid, &table, &points, every, &mut again, &mut fast);
            assert_eq!(again, fast_values);
            for (&x, fast) in points.iter().step_by(every).zip(fast.chunks_exact(D * k)) {
                let mut slow = vec![[0.0; D]; k];
                reference::jacobian(grid, &table, x, &mut slow);
                for a in 0..D {
                    let slow: Vec<f32> = slow.iter().map(|row| row[a]).collect();
                    // Both round position · resolution, which a slope along another axis then carries, times its own
                    // resolution: up to 64 cells along either.
                    assert_close(&fast[a * k..][..k], &slow, eps);
                }
            }
        }

        // Sums of the same terms in the same order; an entry collects at most a few dozen of them.
        let by_level = |d: &[f32]| -> Vec<f32> {
            let features = k / grid.levels().len();
            let level = |l: usize| d.chunks_exact(k).flat_map(move |row| &row[l * features..][..features]);
            (0..grid.levels().len()).flat_map(level).copied().collect()
        };
        let (mut fast, mut slow) = (vec![0.0; grid.n_params()], vec![0.0; grid.n_params()]);
        cpu::backward(grid, &points, &by_level(&d_out), &mut fast);
        for (&x, d) in points.iter().zip(d_out.chunks_exact(k)) {
            reference::backward(grid, x, d, &mut slow);
        }
        assert_close(&fast, &slow, eps * 4.0);

        let s = uniform_f32(4, n, -1.0, 1.0);
        let u: Vec<Vec<f32>> = (0..3).map(|a| uniform_f32(5 + a, n, -1.0, 1.0)).collect();
        fast.fill(0.0);
        slow.fill(0.0);
        cpu::backward_with_jacobian(grid, &points, &by_level(&d_out), &s, [&u[0], &u[1], &u[2]], &mut fast);
        for (p, (&x, d)) in points.iter().zip(d_out.chunks_exact(k)).enumerate() {
            let scaled: Vec<f32> = d.iter().map(|d| d * s[p]).collect();
            reference::backward(grid, x, &scaled, &mut slow);
            reference::backward_jacobian(grid, x, d, std::array::from_fn(|a| u[a][p]), &mut slow);
        }
        assert_close(&fast, &slow, eps * 4.0);
    }
    for n in [0, 1, 7, 8, 9, 200] {
        for n_features in [1, 2, 4, 8] {
            check(&grid3(n_features), n);
            check(&grid2(n_features), n);
        }
    }
}

#[test]
fn scatter_in_parts_adds_and_marks_as_in_one_piece() {
    let grid = grid3(2);
    let points: Vec<[f32; 3]> = points(5, 20);
    let d = uniform_f32(6, points.len() * 2, -1.0, 1.0);
    let incoming = cpu::Incoming { d: &d, s: &[], u: [&[]; 3] };
    for (l, level) in grid.levels().iter().enumerate() {
        let run = |range: std::ops::Range<usize>| {
            let mut gradient = vec![0.0; range.len() * 2];
            let mut touched = vec![0u8; gradient.len().div_ceil(16)];
            cpu::scatter(&grid, l, &points, incoming, range, &mut gradient, &mut touched);
            (gradient, touched)
        };
        let (whole, marks) = run(0..level.n_entries);
        let middle = level.n_entries / 2 / 8 * 8;
        let (left, right) = (run(0..middle), run(middle..level.n_entries));
        assert_eq!(whole, [left.0, right.0].concat());
        assert_eq!(marks, [left.1, right.1].concat());
        for (line, &mark) in whole.chunks(16).zip(&marks) {
            // An entry whose weight is 0 may leave a mark without a gradient, never the other way round.
            assert!(mark == 1 || line.iter().all(|&g| g == 0.0));
        }
        assert!(marks.contains(&1));
    }
}

#[test]
fn not_a_number_is_clamped_not_a_panic() {
    let grid = grid3(2);
    let table = uniform_f32(1, grid.n_params(), -1.0, 1.0);
    let mut out = vec![0.0; 3 * grid.n_features()];
    cpu::forward(&grid, &table, &[[f32::NAN; 3], [f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], &mut out);
    assert!(out.iter().all(|x| x.is_finite()));
}

#[test]
fn bad_configurations_are_errors() {
    let good = config([5, 4, 3], [40, 30, 3], 2);
    let bad = |change: fn(&mut HashGridConfig<3>)| {
        let mut c = good.clone();
        change(&mut c);
        HashGrid::new(&c).unwrap_err()
    };
    assert_eq!(bad(|c| c.n_levels = 0), HashGridError::Levels(0));
    assert_eq!(bad(|c| c.n_features_per_level = 3), HashGridError::Features(3));
    assert_eq!(bad(|c| c.log2_hashmap_size = 40), HashGridError::TableSize(40));
    assert!(matches!(bad(|c| c.base_resolution[1] = 0), HashGridError::Resolution { axis: 1, .. }));
    assert!(matches!(bad(|c| c.finest_resolution[2] = 1), HashGridError::Resolution { axis: 2, .. }));
}
