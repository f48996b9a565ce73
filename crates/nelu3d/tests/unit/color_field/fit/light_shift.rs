use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::fit::light_shift::{changes, solve};
use nelu3d::color_field::fit::{LeastSquares, NormalEquations, Smoothness};
use nelu3d::color_field::grid::Grid;
use nelu3d::progress::Progress;

use super::unit;

const CELLS: [usize; 3] = [96, 64, 1];

/// A wave of 20 cells a period along a, and of 28 along b if there is one, whose rays lean by `shift`.
fn waves([a, b, w]: [f32; 3], shift: [f32; 3], along_b: bool) -> f32 {
    let [x, y] = [(a - 0.5) * CELLS[0] as f32, (b - 0.5) * CELLS[1] as f32];
    let u = w - 0.5;
    let [x, y] = [x + u * (shift[0] + shift[2] * x), y + u * (shift[1] + shift[2] * y)];
    let tau = std::f32::consts::TAU;
    0.5 + 0.2 * (tau * x / 20.0).sin() + if along_b { 0.2 * (tau * y / 28.0).sin() } else { 0.0 }
}

/// Returns the shift that two strips of three boards tell.
fn told(shift: [f32; 3], along_b: bool) -> [f64; 3] {
    let mut equations = NormalEquations::none();
    let mut unit = unit(5);
    for window in [[0..96, 16..48], [32..64, 0..64]] {
        let cells = [window[0].len(), window[1].len(), 1];
        let mut bins = Bins::new([cells[0], cells[1], 4], 1);
        for i in 0..3 * cells[0] * cells[1] * 4 {
            let q = [unit(), unit(), [0.1, 0.5, 0.9][i % 3]];
            let of_field = |i: usize| (q[i] * cells[i] as f32 + window[i].start as f32) / CELLS[i] as f32;
            let noise = 0.1 * (unit() + unit() - 1.0);
            bins.add(q, &[waves([of_field(0), of_field(1), q[2]], shift, along_b) + noise], &[1.0]);
        }
        let stiff =
            Smoothness { across: 1e-2, along: 1e3, slope_along: 1e3, of_channels: vec![[1.0; 3]], defocus: None };
        let problem = LeastSquares::new(cells, &bins);
        let mut grid = Grid::new(cells, 1);
        problem.solve(&mut grid, &stiff, 40, &Progress::none());
        let columns = changes(&grid, [window[0].start, window[1].start], [CELLS[0], CELLS[1]]);
        let of_window = problem.equations_of(&grid, &columns, &stiff, 10, &Progress::none());
        equations.add(&of_window, &nalgebra::Matrix3::identity());
    }
    solve(&equations, [CELLS[0], CELLS[1]]).unwrap().into()
}

/// By how much the rays lean is found along both axes, and how much more they spread.
#[test]
fn samples_tell_where_the_light_is_instead() {
    let shift = [0.8, -0.6, 0.015];
    let found = told(shift, true);
    assert!((found[0] - 0.8).abs() < 0.08 && (found[1] + 0.6).abs() < 0.08, "{found:?}");
    assert!((found[2] - 0.015).abs() < 0.002, "{found:?}");
}

/// A code along one axis does not tell where the light is along the other, and it stays there.
#[test]
fn what_the_code_leaves_open_stays() {
    let found = told([0.8, 0.0, 0.015], false);
    assert!((found[0] - 0.8).abs() < 0.08 && (found[2] - 0.015).abs() < 0.004, "{found:?}");
    assert!(found[1].abs() < 0.3, "{found:?}");
}
