use crate::check::uniform_f32;
use nelu3d_field::plate::{PlateStop, PlateSystem, reference, sweep};

/// A window with a hole, uneven weights, and data that say nothing over a part of it.
struct Example {
    width: usize,
    height: usize,
    active: Vec<bool>,
    weights: [Vec<f32>; 3],
    h: Vec<f32>,
    g: Vec<f32>,
    x: Vec<f32>,
}

impl Example {
    fn new(width: usize, height: usize) -> Self {
        let n = width * height;
        let ring = |x: usize, y: usize| x == 0 || x == width - 1 || y == 0 || y == height - 1;
        let hole = |x: usize, y: usize| (15..18).contains(&x) && y > 10;
        let active: Vec<bool> = (0..n).map(|i| !ring(i % width, i / width) && !hole(i % width, i / width)).collect();
        let a = |i: usize| active[i];
        let exists = |i: usize| {
            if !a(i) {
                return [false; 3];
            }
            let w = width;
            [a(i - 1) && a(i + 1), a(i - w) && a(i + w), a(i + 1) && a(i + w) && a(i + w + 1)]
        };
        let random = uniform_f32(5, 3 * n, -3.0, 3.0);
        let weights =
            [0, 1, 2].map(|d| (0..n).map(|i| if exists(i)[d] { random[d * n + i].exp() } else { 0.0 }).collect());
        let (information, gradient) = (uniform_f32(6, n, 0.1, 2.0), uniform_f32(7, n, -1.0, 1.0));
        let data = |v: &[f32]| (0..n).map(|i| if a(i) && i % width % 50 > 4 { v[i] } else { 0.0 }).collect();
        let surface = uniform_f32(8, n, -1.0, 1.0);
        let x = (0..n).map(|i| if a(i) { surface[i] + 0.1 * (i % width) as f32 } else { 0.0 }).collect();
        Self { width, height, weights, h: data(&information), g: data(&gradient), x, active }
    }

    fn system(&self) -> PlateSystem<'_> {
        let [xx, yy, xy] = &self.weights;
        PlateSystem { width: self.width, height: self.height, active: &self.active, xx, yy, xy, h: &self.h, g: &self.g }
    }
}

const EXACT: PlateStop = PlateStop { reduction: 1e-6, settled: 0.0, iterations: 2000 };

/// Returns the largest difference between a changed surface and a reference's change.
fn difference(example: &Example, x: &[f32], change: &[f64]) -> f64 {
    (0..x.len()).map(|i| (f64::from(x[i] - example.x[i]) - change[i]).abs()).fold(0.0, f64::max)
}

#[test]
fn a_window_that_one_tile_holds_is_solved_in_one_sweep() {
    for (width, height) in [(62, 62), (40, 30), (3, 9)] {
        let example = Example::new(width, height);
        let (change, iterations) = reference::solve(&example.system(), &example.x, EXACT);
        assert!(iterations < EXACT.iterations);
        let mut x = example.x.clone();
        let done = sweep(&example.system(), &mut x, 0, 1e9, EXACT);
        assert_eq!((done.tiles, done.products > 0), (1, true));
        let largest = change.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        let error = difference(&example, &x, &change);
        assert!(error < 1e-3 * largest, "{width} × {height}: {error} of {largest}");
        assert!((0..x.len()).all(|i| example.active[i] || x[i] == 0.0));
    }
}

/// Every sweep lowers what the solution minimizes, and a few of them reach it.
#[test]
fn sweeps_of_many_tiles_come_to_the_solution_of_all_pixels_together() {
    let example = Example::new(190, 150);
    let system = example.system();
    let (change, _) = reference::solve(&system, &example.x, EXACT);
    let least = reference::objective(&system, &example.x, &change);
    let begin = reference::objective(&system, &example.x, &vec![0.0; change.len()]);
    let mut x = example.x.clone();
    let (mut g, mut before) = (example.g.clone(), begin);
    for turn in 0..6 {
        let start = x.clone();
        sweep(&PlateSystem { g: &g, ..system }, &mut x, turn, 1e9, EXACT);
        // The gradient of the data belongs to where the surface is.
        for i in 0..g.len() {
            g[i] += example.h[i] * (x[i] - start[i]);
        }
        let moved: Vec<f64> = x.iter().zip(&example.x).map(|(x, from)| f64::from(x - from)).collect();
        let now = reference::objective(&system, &example.x, &moved);
        assert!(now <= before + 1e-6 * (begin - least), "turn {turn}: {now} after {before}");
        before = now;
    }
    assert!(before - least < 1e-4 * (begin - least), "{before} of {least}, from {begin}");
}

#[test]
fn changes_are_limited_and_the_number_of_threads_does_not_matter() {
    let example = Example::new(150, 130);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut x = example.x.clone();
        let done = pool.install(|| sweep(&example.system(), &mut x, 3, 0.25, EXACT));
        (x, done)
    };
    let (one, many) = (run(1), run(3));
    assert_eq!(one.1, many.1);
    assert!(one.0.iter().zip(&many.0).all(|(a, b)| a.to_bits() == b.to_bits()));
    let largest = one.0.iter().zip(&example.x).fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
    assert!((0.2..0.2501).contains(&largest), "{largest}");
}

/// A plane costs nothing, however slanted, so nothing moves.
#[test]
fn a_plane_without_data_stays() {
    let mut example = Example::new(70, 80);
    let plane = |i: usize| 3.0 + 0.25 * (i % 70) as f32 - 0.125 * (i / 70) as f32;
    example.x = (0..70 * 80).map(|i| if example.active[i] { plane(i) } else { 0.0 }).collect();
    example.g.fill(0.0);
    let mut x = example.x.clone();
    sweep(&example.system(), &mut x, 1, 1.0, PlateStop { settled: 1e-9, ..EXACT });
    assert!(x.iter().zip(&example.x).all(|(a, b)| (a - b).abs() < 1e-3));
}
