use nelu3d::color_field::fit::Smoothness;
use nelu3d::color_field::fit::penalty::Penalty;
use nelu3d::color_field::grid::Grid;

/// Second differences along each axis, taken and put back one by one, and first differences along w.
#[test]
fn is_the_sum_of_squared_differences() {
    for (cells, k) in [([1, 2, 1], 1), ([18, 3, 2], 2), ([37, 5, 4], 3)] {
        let mut grid = Grid::new(cells, k);
        for (i, c) in grid.coeffs.iter_mut().enumerate() {
            *c = ((i * 7919) % 1000) as f32 * 1e-3;
        }
        let lambda: Vec<f32> = (0..k).map(|c| 1.0 + c as f32).collect();
        let mut y = vec![f32::NAN; grid.coeffs.len()];
        let of_channels: Vec<[f32; 3]> = (0..k).map(|c| [1.0, 2.0 + c as f32, 0.5]).collect();
        let smooth = Smoothness { across: 0.3, along: 0.7, slope_along: 0.2, of_channels, defocus: None };
        Penalty::new(&grid, &smooth, &lambda).apply(&grid.coeffs, &mut y);

        let nodes @ [na, _, nw] = grid.nodes();
        let steps = [nw * k, na * nw * k, k];
        let mut expected = vec![0.0f64; y.len()];
        for i in 0..y.len() {
            let at = [i / k / nw % na, i / k / nw / na, i / k % nw];
            let mut add = |axis: usize, strength: f32, differences: &[(usize, f64)]| {
                if at[axis] + differences.len() <= nodes[axis] {
                    let of = |n: usize| i + n * steps[axis];
                    let factor = smooth.of_channels[i % k][axis];
                    let sum: f64 = differences.iter().map(|(n, d)| d * f64::from(grid.coeffs[of(*n)])).sum();
                    for (n, d) in differences {
                        expected[of(*n)] += f64::from(strength * lambda[i % k] * factor) * d * sum;
                    }
                }
            };
            let second = [(0, 1.0), (1, -2.0), (2, 1.0)];
            add(0, smooth.across, &second);
            add(1, smooth.across, &second);
            add(2, smooth.along, &second);
            add(2, smooth.slope_along, &[(0, -1.0), (1, 1.0)]);
        }
        for (y, expected) in y.iter().zip(expected) {
            assert!((f64::from(*y) - expected).abs() < 2e-5, "{cells:?} {k}: {y} {expected}");
        }
    }
}

/// Where a function is straight, its penalty is nothing but the rounding of what it bends, however large its values are.
/// Products of values with coefficients that cancel leave 1e-7 of the values, which is more than samples weigh.
#[test]
fn straight_functions_have_no_penalty() {
    let mut grid = Grid::new([64, 48, 2], 1);
    let [na, nb, nw] = grid.nodes();
    for (i, c) in grid.coeffs.iter_mut().enumerate() {
        *c = 0.7 + 3e-3 * (i / nw % na) as f32 - 2e-3 * (i / nw / na) as f32;
    }
    let smooth = Smoothness { across: 1e4, along: 1e4, slope_along: 0.0, of_channels: vec![[1.0; 3]], defocus: None };
    let mut y = vec![f32::NAN; grid.coeffs.len()];
    Penalty::new(&grid, &smooth, &[1.0]).apply(&grid.coeffs, &mut y);
    let exact = |x: &[f32]| -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for (stride, n, of) in [(nw, na, na * nw), (na * nw, nb, na * nb * nw)] {
            for i in (0..x.len()).filter(|i| i % of / stride + 2 < n) {
                let at = [i, i + stride, i + 2 * stride];
                let d = f64::from(x[at[0]]) - 2.0 * f64::from(x[at[1]]) + f64::from(x[at[2]]);
                at.into_iter().zip([1.0, -2.0, 1.0]).for_each(|(j, c)| y[j] += 1e4 * c * d);
            }
        }
        y
    };
    let worst = y.iter().zip(exact(&grid.coeffs)).map(|(y, e)| (f64::from(*y) - e).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-4, "{worst}");
}

/// A function costs as much on a lattice of 4 times fewer cells across as on the fine one, whose nodes have a
/// sixteenth of the samples each; but a factor of 1 is not lowered.
#[test]
fn a_function_costs_the_same_on_a_coarser_lattice() {
    let smooth =
        Smoothness { across: 0.3, along: 0.0, slope_along: 0.0, of_channels: vec![[1e5, 1e4, 1.0]], defocus: None };
    let cost = |cells: usize, smooth: &Smoothness| {
        let mut grid = Grid::new([cells, cells, 1], 1);
        let [na, nb, nw] = grid.nodes();
        // The coefficients of a cubic spline are nearly its values at places a cell apart.
        let at = |i: usize| (i as f32 - 1.0) / cells as f32;
        for (i, c) in grid.coeffs.iter_mut().enumerate() {
            *c = (20.0 * at(i / nw % na)).sin() + (16.0 * at(i / nw / na)).cos();
        }
        assert_eq!(grid.coeffs.len(), na * nb * nw);
        let mut y = vec![0.0; grid.coeffs.len()];
        let samples_per_node = 1e6 / (cells * cells) as f32;
        Penalty::new(&grid, smooth, &[samples_per_node]).apply(&grid.coeffs, &mut y);
        grid.coeffs.iter().zip(&y).map(|(c, y)| f64::from(c * y)).sum::<f64>()
    };
    let (fine, coarse) = (cost(160, &smooth), cost(40, &smooth.of_coarser(4)));
    assert!((coarse / fine - 1.0).abs() < 0.15, "{fine} {coarse}");
    let least = Smoothness { of_channels: vec![[1.0, 0.5, 1.0]], ..smooth };
    assert_eq!(least.of_coarser(4).of_channels, [[1.0, 0.5, 1.0]]);
}
