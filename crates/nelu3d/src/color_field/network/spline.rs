//! The spline through a network's values.

use crate::color_field::grid::Grid;

/// Returns the spline through a function's values at the corners of the volume's cells, with no curvature at its ends.
/// `query(points, values)` evaluates the function.
pub(in crate::color_field) fn spline_through(
    cells: [usize; 3],
    k: usize,
    query: impl Fn(&[[f32; 3]], &mut [f32]),
) -> Grid {
    let mut grid = Grid::new(cells, k);
    let nodes @ [na, nb, nw] = grid.nodes();
    let at = |i: usize, n: usize| ((i as f32 - 1.0) / n as f32).clamp(0.0, 1.0);
    let points: Vec<[f32; 3]> = (0..nb * na * nw)
        .map(|i| [at(i / nw % na, cells[0]), at(i / nw / na, cells[1]), at(i % nw, cells[2])])
        .collect();
    let mut values = vec![0.0; points.len() * k];
    query(&points, &mut values);
    for (axis, stride) in [(0, nw * k), (1, na * nw * k), (2, k)] {
        values_to_coeffs(&mut values, stride, nodes[axis]);
    }
    grid.coeffs = values;
    grid
}

/// Turns, along one axis, values at the nodes of a uniform cubic B-spline into its coefficients, in place: the `n`
/// nodes of a line lie `stride` apart, the first and last outside the interval, whose values are not read.
///
/// Interior: `(c₋ + 4 c + c₊) / 6 = v`. At the ends of the interval the second derivative `c₋ − 2 c + c₊` is 0, so
/// `c = v` there. The rest is a tridiagonal system, solved by elimination.
fn values_to_coeffs(values: &mut [f32], stride: usize, n: usize) {
    // The first and last node inside the interval.
    let (first, last) = (1, n - 2);
    for line in values.chunks_exact_mut(n * stride) {
        let mut upper = vec![0.0; n];
        for i in first + 1..last {
            upper[i] = 1.0 / (4.0 - upper[i - 1]);
            let (before, here) = line.split_at_mut(i * stride);
            for (v, below) in here[..stride].iter_mut().zip(&before[(i - 1) * stride..]) {
                *v = (6.0 * *v - below) * upper[i];
            }
        }
        for i in (first + 1..last).rev() {
            let (here, after) = line.split_at_mut((i + 1) * stride);
            for (v, above) in here[i * stride..].iter_mut().zip(&after[..stride]) {
                *v -= upper[i] * above;
            }
        }
        for i in 0..stride {
            let at = |node: usize| node * stride + i;
            line[at(0)] = 2.0 * line[at(1)] - line[at(2)];
            line[at(n - 1)] = 2.0 * line[at(n - 2)] - line[at(n - 3)];
        }
    }
}
