use nelu3d::calibrate::fringes::carry;
use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::validity::{KnownAxes, Validity};

const N: [usize; 2] = [220, 160];

/// Bins and validity of a board's white squares, of `square` columns, under a code.
fn chessboard(square: usize, k: usize, code: impl Fn([f64; 2]) -> Vec<f32>) -> (Bins, Validity) {
    // Samples lie anywhere in their column.
    chessboard_at(square, k, code, anywhere, 1)
}

fn anywhere(i: usize) -> [f64; 2] {
    [0.618_034, 0.754_878].map(|s| (i as f64 * s).fract())
}

/// Bins, `cells_per_pixel` a column, and validity of a board's white squares, with the place of each column's sample in
/// it.
fn chessboard_at(
    square: usize,
    k: usize,
    code: impl Fn([f64; 2]) -> Vec<f32>,
    place: impl Fn(usize) -> [f64; 2],
    cells_per_pixel: usize,
) -> (Bins, Validity) {
    let mut bins = Bins::new([N[0] * cells_per_pixel, N[1] * cells_per_pixel, 4], k);
    let mut validity = Validity::new(32, 32, 8, [N[0] / 2, N[1] / 2, 8]);
    for i in 0..N[0] * N[1] {
        let [a, b] = [i % N[0], i / N[0]];
        let [x, y] = place(i);
        let at = [a as f64 + x, b as f64 + y];
        let is_white = (a / square + b / square).is_multiple_of(2);
        let q = [(at[0] / N[0] as f64) as f32, (at[1] / N[1] as f64) as f32, 0.4];
        if is_white {
            validity.add([5.0, 5.0], 700.0, q);
        }
        bins.add(q, &code(at), &vec![if is_white { 2500.0 } else { 3.0 }; k]);
    }
    (bins, validity)
}

/// Phase shifts along both axes of a light that is tilted and not parallel.
fn phases([x, y]: [f64; 2]) -> Vec<f32> {
    let u = (x + 0.08 * y) / (1.0 + 4e-4 * y);
    let v = (y - 0.05 * x) / (1.0 + 3e-4 * x);
    let wave =
        |u: f64, period: f64, shift: f64| (0.5 + 0.45 * (std::f64::consts::TAU * (u / period + shift)).cos()) as f32;
    vec![wave(u, 4.5, 0.0), wave(u, 60.0, 0.3), wave(v, 5.0, 0.1), wave(v, 70.0, 0.6)]
}

#[test]
fn black_squares_get_the_codewords_of_their_stripes() {
    squares_get_the_codewords_of_their_stripes(1);
}

/// A field may have more cells than the samples of few boards fill: a column is a pixel wide all the same.
#[test]
fn so_they_do_where_most_cells_are_empty() {
    squares_get_the_codewords_of_their_stripes(2);
}

fn squares_get_the_codewords_of_their_stripes(cells_per_pixel: usize) {
    let (bins, validity) = chessboard_at(14, 4, phases, anywhere, cells_per_pixel);
    let carried = carry(&bins, &validity, None, cells_per_pixel).unwrap();
    assert!(carried.report.rms < 0.05, "{:?}", carried.report);
    let squares = N[0] * N[1] / 2;
    assert!(carried.places.len() > 3 * squares, "{} samples, {squares} dark columns", carried.places.len());
    let mut filled = Bins::new([N[0] * cells_per_pixel, N[1] * cells_per_pixel, 4], 4);
    filled.add_all(&[carried.samples]);
    let (mut n, mut off) = (0, 0.0);
    filled.for_each_sample(|q, values, _| {
        let truth = phases([f64::from(q[0]) * N[0] as f64, f64::from(q[1]) * N[1] as f64]);
        n += 1;
        off += values.iter().zip(truth).map(|(v, t)| f64::from((v - t).powi(2))).sum::<f64>() / 4.0;
    });
    assert!((off / f64::from(n)).sqrt() < 0.05, "{}", (off / f64::from(n)).sqrt());
}

#[test]
fn stripes_that_run_nearly_along_the_columns_are_followed_to_a_sample_on_them() {
    // With samples in the columns' middles, every one within 22 columns of a stripe's own lies beside it: 0.1 columns
    // and more.
    let leaning = |[x, y]: [f64; 2]| {
        let wave = |period: f64| (0.5 + 0.45 * (std::f64::consts::TAU * (x + 0.04 * y) / period).cos()) as f32;
        vec![wave(12.0), wave(60.0)]
    };
    let (bins, validity) = chessboard_at(30, 2, leaning, |_| [0.5; 2], 1);
    let carried = carry(&bins, &validity, None, 1).unwrap();
    assert!(carried.report.rms < 0.05, "{:?}", carried.report);
    let dark = N[0] * N[1] / 2;
    assert!(carried.places.len() > 3 * dark, "{} samples, {dark} dark columns", carried.places.len());
}

#[test]
fn codes_without_stripes_are_left_alone() {
    let dots = |[x, y]: [f64; 2]| {
        let cell = ((x / 3.0) as u32).wrapping_mul(2_654_435_761) ^ ((y / 3.0) as u32).wrapping_mul(40_503);
        vec![(cell.wrapping_mul(2_246_822_519) >> 31) as f32; 2]
    };
    let (bins, validity) = chessboard(14, 2, dots);
    assert!(carry(&bins, &validity, None, 1).is_none());
}

#[test]
fn beside_a_board_the_stripes_that_cross_it_are_known() {
    // Nothing was right of column 150, where stripes along x come from the left, and those along y from nowhere.
    let edge = 150.0 / N[0] as f32;
    let (bins, _) = chessboard(14, 4, phases);
    let mut left = Bins::new([N[0], N[1], 4], 4);
    let mut validity = Validity::new(32, 32, 8, [N[0] / 2, N[1] / 2, 8]);
    bins.for_each_sample(|q, values, omegas| {
        if q[0] < edge {
            left.add(q, values, omegas);
            if omegas[0] > 100.0 {
                validity.add([5.0, 5.0], 700.0, q);
            }
        }
    });
    let carried = carry(&left, &validity, None, 1).unwrap();
    assert!(carried.axes[0] == carried.axes[1] && carried.axes[2] == carried.axes[3]);
    assert_ne!(carried.axes[0], carried.axes[2]);
    let (along_x, along_y) = (carried.axes[2], carried.axes[0]);
    let beside: Vec<KnownAxes> = carried.places.iter().filter(|p| p.0[0] > edge + 0.03).map(|p| p.1).collect();
    assert!(beside.len() > 1000, "{}", beside.len());
    assert!(beside.iter().all(|known| known.has(along_x) && !known.has(along_y)));
    assert!(carried.report.one_axis > 0.02 && carried.report.share > 0.2, "{:?}", carried.report);
    // What is carried there is right, and the other channels weigh nothing.
    let mut filled = Bins::new([N[0], N[1], 4], 4);
    filled.add_all(&[carried.samples]);
    let (mut n, mut off) = (0, 0.0);
    filled.for_each_sample(|q, values, omegas| {
        if q[0] > edge + 0.03 {
            let truth = phases([f64::from(q[0]) * N[0] as f64, f64::from(q[1]) * N[1] as f64]);
            assert!(omegas[0] == 0.0 && omegas[1] == 0.0 && omegas[2] > 0.0);
            n += 2;
            off += [2, 3].iter().map(|j| f64::from((values[*j] - truth[*j]).powi(2))).sum::<f64>();
        }
    });
    assert!((off / f64::from(n)).sqrt() < 0.08, "{}", (off / f64::from(n)).sqrt());
    // Only where it is asked for.
    let nowhere = Validity { lit: vec![0; validity.lit.len()], ..validity.clone() };
    assert!(carry(&left, &validity, Some(&nowhere), 1).is_none());
}

#[test]
fn a_white_board_needs_nothing() {
    let (bins, validity) = chessboard(1000, 4, phases);
    assert!(carry(&bins, &validity, None, 1).is_none());
}

/// Where many boards were, one column or another has no sample by chance: one in fifty here.
#[test]
fn single_columns_without_samples_need_nothing() {
    let (bins, validity) = chessboard(1000, 4, phases);
    let (mut with_holes, mut n) = (Bins::new([N[0], N[1], 4], 4), 0);
    bins.for_each_sample(|q, values, weights| {
        n += 1;
        if n % 50 != 0 {
            with_holes.add(q, values, weights);
        }
    });
    assert!(carry(&with_holes, &validity, None, 1).is_none());
}
