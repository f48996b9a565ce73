use nelu3d::color_field::grid::Grid;

/// A finer spline is the same cubic, in and beyond its cells; along an axis with as many cells it is the same whatever
/// it was.
#[test]
fn resampled_is_the_same_function() {
    let (from, to, k) = ([3, 5, 2], [7, 5, 3], 2);
    let of = |x: f64, c: f64| 0.3 + x * (0.7 - c) - x * x * (1.1 + c) + 0.9 * x.powi(3);
    let any = |i: usize| ((i * 7919) % 1000) as f32 * 1e-3;
    // A cubic's coefficients are v − h² v″/6 of its values v at nodes h apart.
    let coeff = |cells: usize, node: usize, c: f64| {
        let (h, x) = (1.0 / cells as f64, (node as f64 - 1.0) / cells as f64);
        of(x, c) - (of(x - h, c) - 2.0 * of(x, c) + of(x + h, c)) / 6.0
    };
    let make = |cells: [usize; 3]| {
        let mut grid = Grid::new(cells, k);
        let [na, _, nw] = grid.nodes();
        for (i, value) in grid.coeffs.iter_mut().enumerate() {
            let (c, at) = ((i % k) as f64, [i / k / nw % na, i / k / nw / na, i / k % nw]);
            let cubics = coeff(cells[0], at[0], c) * coeff(cells[2], at[2], 0.5 * c);
            *value = any(at[1]) * cubics as f32;
        }
        grid
    };
    let (found, expected) = (make(from).resampled(to), make(to));
    for (i, (found, expected)) in found.coeffs.iter().zip(&expected.coeffs).enumerate() {
        assert!((found - expected).abs() < 1e-5, "{i}: {found} {expected}");
    }
}

/// The coefficients that interpolate give their values back at the nodes inside, away from the ends.
#[test]
fn interpolated_values_are_had_at_nodes() {
    let (cells, k) = ([6, 8, 7], 2);
    let mut grid = Grid::new(cells, k);
    let [na, nb, nw] = grid.nodes();
    let smooth =
        |at: [usize; 3], c: usize| (0.2 * at[0] as f32 + 0.3 * at[1] as f32 - 0.1 * at[2] as f32 + c as f32).sin();
    let at = |node: usize| [node / nw % na, node / nw / na, node % nw];
    let values: Vec<f32> = (0..na * nb * nw * k).map(|i| smooth(at(i / k), i % k)).collect();
    grid.interpolate(&values);
    let mut found = vec![0.0; k];
    for node in 0..na * nb * nw {
        let at = at(node);
        if (0..3).all(|i| (3..cells[i]).contains(&at[i])) {
            grid.eval(std::array::from_fn(|i| (at[i] as f32 - 1.0) / cells[i] as f32), &mut found);
            for (c, found) in found.iter().enumerate() {
                assert!((found - smooth(at, c)).abs() < 0.01, "{at:?}: {found} {}", smooth(at, c));
            }
        }
    }
}
