use nalgebra::Vector4;
use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::fit::defocus::{Defocus, changes};
use nelu3d::color_field::fit::{LeastSquares, NormalEquations, Smoothness};
use nelu3d::color_field::grid::Grid;
use nelu3d::progress::Progress;

use super::unit;

const CELLS: [usize; 3] = [96, 48, 2];
const BETA: [f64; 4] = [8.0, 1.0, -2.0, 1.5];

/// A wave of 20 cells a period along a and 32 along b, out of focus by `beta` at unit coordinates: the Laplacian of a
/// wave is itself times minus its frequency squared.
fn wave([a, b, w]: [f32; 3], beta: [f64; 4]) -> f32 {
    let [x, y, u] = [a - 0.5, b - 0.5, w - 0.5].map(f64::from);
    let beta = beta[0] * u * u + u * (beta[1] + beta[2] * x + beta[3] * y);
    let frequency = [std::f64::consts::TAU / 20.0, std::f64::consts::TAU / 32.0];
    let contrast = 1.0 - beta * frequency.iter().map(|f| f * f).sum::<f64>();
    let phase = frequency[0] * f64::from(a) * CELLS[0] as f64 + frequency[1] * f64::from(b) * CELLS[1] as f64;
    (0.5 + 0.5 * contrast * phase.cos()) as f32
}

/// Samples of three boards.
fn samples() -> Bins {
    let mut bins = Bins::new([96, 48, 4], 1);
    let mut unit = unit(5);
    for i in 0..3 * 96 * 48 * 4 {
        let q = [unit(), unit(), [0.1, 0.5, 0.9][i % 3]];
        bins.add(q, &[wave(q, BETA)], &[1.0]);
    }
    bins
}

/// Stiff along w, as of a few boards.
fn stiff(defocus: Option<Defocus>) -> Smoothness {
    Smoothness { across: 1.0, along: 1e3, slope_along: 1e3, of_channels: vec![[1.0; 3]], defocus }
}

/// A spline that is stiff along w follows patterns that go out of focus where it is known how, between the boards, too,
/// and not where it is not.
#[test]
fn a_stiff_spline_goes_out_of_focus() {
    let bins = samples();
    let off = |defocus: Option<Defocus>| {
        let problem = LeastSquares::new(CELLS, &bins);
        let mut grid = Grid::new(CELLS, 1);
        problem.solve_once(&mut grid, &stiff(defocus), 40, &Progress::none());
        let (mut unit, mut v, mut sum) = (unit(6), vec![0.0; 1], 0.0);
        for _ in 0..2000 {
            let q = [0.1 + 0.8 * unit(), 0.1 + 0.8 * unit(), 0.1 + 0.8 * unit()];
            grid.eval(q, &mut v);
            sum += (v[0] - wave(q, BETA)).powi(2);
        }
        (sum / 2000.0).sqrt()
    };
    let (known, unknown) = (off(Some(Defocus { beta: BETA, aspect: 1.0, of_channels: vec![true] })), off(None));
    assert!(known < 0.01 && unknown > 0.03, "{known} {unknown}");
}

/// The equations of two windows of a field tell how it goes out of focus.
#[test]
fn samples_tell_how_patterns_go_out_of_focus() {
    let bins = samples();
    let mut equations = NormalEquations::none();
    for window in [[0..96, 8..40], [16..80, 0..48]] {
        let cells = [window[0].len(), window[1].len(), CELLS[2]];
        let mut of_window = Bins::new([cells[0], cells[1], 4], 1);
        bins.for_each_sample(|q, v, w| {
            let [a, b] = [0, 1].map(|i| (q[i] * CELLS[i] as f32 - window[i].start as f32) / window[i].len() as f32);
            if [a, b].iter().all(|q| (0.0..1.0).contains(q)) {
                of_window.add([a, b, q[2]], v, w);
            }
        });
        let problem = LeastSquares::new(cells, &of_window);
        let mut grid = Grid::new(cells, 1);
        problem.solve(&mut grid, &stiff(None), 40, &Progress::none());
        let of_window = problem.equations_of(&grid, &changes(&grid, 1.0), &stiff(None), 20, &Progress::none());
        equations.add(&of_window, &Defocus::to_window(&window, [CELLS[0], CELLS[1]]));
    }
    let found = equations.solve(&Vector4::zeros()).unwrap();
    // The field in the mean over the boards, averaged with its neighbors, has 0.87 of the curvature.
    for (found, expected) in found.iter().zip(BETA.map(|beta| beta / 0.87)) {
        assert!((found - expected).abs() < 0.1 * expected.abs().max(1.0), "{found} {expected}");
    }
}
