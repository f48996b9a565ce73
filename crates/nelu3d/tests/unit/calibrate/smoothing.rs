use nelu3d::calibrate::smoothing::{Aside, MAX_POWER, RATIO, Search};
use nelu3d::calibrate::spline_fit::{Schedule, SplineFit};
use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::fit::Smoothness;
use nelu3d::color_field::frame::Center;
use nelu3d::progress::Progress;

/// The strengths lie where the error has its minimum, between those that are tried, or at the end to which it falls.
#[test]
fn the_best_strength_lies_between_those_that_are_tried() {
    let found = |error: &dyn Fn([f64; 3]) -> f64| {
        let mut search = Search::new(Center::Light);
        let mut tried = 0;
        while !search.is_done() {
            search.take(error(search.next().map(f64::from)));
            tried += 1;
            assert!(tried < 30);
        }
        search.best()
    };
    let off = |factor: f64, best: f64| 0.1 * (factor / best).ln().powi(2);
    for best in [60.0f64, 300.0, 3e4] {
        for found in found(&|f| 7.0 * f.map(|f| off(f, best)).iter().sum::<f64>().exp()) {
            assert!((f64::from(found) / best - 1.0).abs() < 1e-3, "{best}: {found}");
        }
    }
    // Each has its own.
    let [a, b, w] = found(&|[a, b, w]| 7.0 * (off(a, 900.0) + off(b, 3e5) + off(w, 900.0)).exp());
    let near = |found: f32, best: f32| (found / best).ln().abs() < f32::ln(RATIO);
    assert!(near(a, 900.0) && near(b, 3e5) && near(w, 900.0) && a < b && w < b, "{a} {b} {w}");
    // Noise that asks for smoothness along all axes does not keep that along w, where the code is out of focus.
    let [a, b, w] = found(&|[a, b, w]| 7.0 * (off(a, 3e4) + off(b, 8e5) + 0.5 * off(w, 30.0)).exp());
    assert!(near(a, 3e4) && near(b, 8e5) && near(w, 30.0), "{a} {b} {w}");
    // A wave that is smoothed too far across does not tell how it changes along the light's rays.
    let along = |a: f64, w: f64| {
        let best = if a < 2000.0 { 30.0 } else { 900.0 };
        off(w.max(900.0), 900.0) + 0.15 * off(w.min(900.0), best)
    };
    let [a, b, w] = found(&|[a, b, w]| 7.0 * (0.3 * (off(a, 900.0) + off(b, 8e5)) + along(a, w)).exp());
    assert!(near(a, 900.0) && near(b, 8e5) && near(w, 30.0), "{a} {b} {w}");
    assert_eq!(found(&|f| f.iter().product()), [1.0; 3]);
    assert_eq!(found(&|f| 1.0 / f.iter().product::<f64>()), [RATIO.powi(MAX_POWER - 1); 3]);
    assert_eq!(found(&|_| 0.0), [1.0; 3]);
}

/// Steps along the stripes of a pattern: the first raises the error by 0.7 %, as on a scanner drawn at random, and the
/// second lowers it. A first step that raises it by 9 % ends the line.
#[test]
fn a_step_that_changes_nothing_does_not_end_a_line() {
    let along = |second: f64| {
        let mut search = Search::new(Center::Light);
        while !search.is_done() {
            let [a, b, w] = search.next();
            let others = if a < b || b > 1.0 || w > 1.0 { 2.0 } else { 1.0 };
            search.take(
                others
                    * if a < 2.0 {
                        17_430.0
                    } else if a < 31.0 {
                        second
                    } else {
                        15_000.0 + f64::from(a)
                    },
            );
        }
        search.best()[0]
    };
    assert!((100.0..3000.0).contains(&along(17_560.0)), "{}", along(17_560.0));
    assert!(along(19_000.0) < 2.0, "{}", along(19_000.0));
}

/// The positions that are set aside together, fold by fold.
fn positions_of(aside: &Aside) -> Vec<&[usize]> {
    aside.folds.iter().map(|fold| &fold.positions[..]).collect()
}

/// A sweep of eight positions over 96 × 96 cells whose samples' two values are `code` at unit coordinates along a and b,
/// under noise; returns the strengths that are chosen for the two channels.
fn chosen(code: impl Fn([f32; 2]) -> [f32; 2]) -> Vec<[f32; 3]> {
    chosen_with(code, |_, _| 1.0)
}

/// The strengths that are chosen for such a sweep's two channels where samples of a position are dim, at unit coordinates
/// along a and b: their noise is one over `light` times what it is elsewhere.
fn chosen_with(code: impl Fn([f32; 2]) -> [f32; 2], light: impl Fn(usize, [f32; 2]) -> f32) -> Vec<[f32; 3]> {
    smoothness_of(|[a, b, _]| code([a, b]), light).of_channels
}

/// The smoothness that is chosen where the samples' values are `code` at unit coordinates along a, b, and w.
fn smoothness_of(code: impl Fn([f32; 3]) -> [f32; 2], light: impl Fn(usize, [f32; 2]) -> f32) -> Smoothness {
    let cells = [96, 96, 1];
    let mut bins = Bins::new([96, 96, 4], 2);
    let positions: Vec<usize> = (0..8).collect();
    let mut aside = Aside::new(&positions, false, cells, 1);
    assert_eq!(positions_of(&aside), [[1, 5]]);
    assert_eq!(aside.strips, [[0..96, 32..64], [32..64, 0..96]]);
    let mut state = 3u64;
    let mut unit = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    for p in positions {
        let mut samples = bins.gathered();
        for i in 0..96 * 96 {
            let at = [(i % 96) as f32 + unit(), (i / 96) as f32 + unit()].map(|v| v / 96.0);
            let light = light(p, at);
            let w = (p as f32 + 0.5) / 8.0;
            let values = code([at[0], at[1], w]).map(|v| v + 0.1 * (unit() + unit() + unit() - 1.5) / light);
            samples.push([at[0], at[1], w], &values, &[100.0 * light.powi(2); 2]);
        }
        aside.keep(p, &samples);
        bins.add_all(&[samples]);
    }
    assert_eq!(aside.folds[0].samples.len(), 2);
    let count = |bins: &Bins| {
        let mut sum = 0.0;
        bins.for_each_sample(|_, _, w| sum += f64::from(w[0]));
        sum
    };
    let before = count(&bins);
    let prepare = |bins: &Bins, cells: [usize; 3]| SplineFit::new(bins, cells, Schedule::of(Center::Light, false));
    let chosen = aside.choose(&mut bins, 1, 1.0, Center::Light, prepare, &Progress::none());
    assert!((count(&bins) / before - 1.0).abs() < 1e-6, "what was set aside is in the bins again");
    chosen
}

/// The strength that [`Aside::choose`] finds for a channel of one wave across the field is above 1000, and for one of
/// twenty waves under the same noise at most 30.
#[test]
fn a_slow_code_is_smoothed_more_than_a_fast_one() {
    let wave = |at: f32, periods: f32| 0.5 + 0.5 * (std::f32::consts::TAU * at * periods).cos();
    let chosen = chosen(|[a, _]| [wave(a, 1.0), wave(a, 20.0)]);
    assert!(chosen[0][0] >= 1e3 && chosen[1][0] <= 30.0, "{chosen:?}");
}

/// The one edge of a coarse bit is seen where it is, whichever way it runs and beside the middle, too: a strip along it
/// shows a channel that is flat, and smoothing that no flat channel minds blurs the edge.
#[test]
fn a_single_edge_beside_the_middle_is_not_blurred() {
    let edge = |at: f32| f32::from(at > 0.8);
    for axis in 0..2 {
        let chosen = chosen(|at| [edge(at[axis]), 0.0]);
        let [across, flat] = [chosen[0][axis], chosen[1][axis]];
        assert!(across <= 900.0 && flat >= 1e5, "axis {axis}: {chosen:?}");
    }
}

/// Two waves that lose contrast away from the plane in focus, which lies across the volume at a slant: what they lose
/// in common is found, as that of the averaged field, and is not there where they keep their contrast.
#[test]
fn what_patterns_lose_out_of_focus_is_found() {
    let tau = std::f32::consts::TAU;
    // Of waves with so many cells a period, the Laplacian is the wave times −(2π / period)².
    let waves = |beta: f32, a: f32| {
        [8.0f32, 12.0].map(|period| {
            let contrast = 1.0 - beta * (tau / period).powi(2);
            0.5 + 0.5 * contrast * (tau * a * 96.0 / period).cos()
        })
    };
    let lost = |[a, _, w]: [f32; 3]| {
        let u = w - 0.5;
        4.0 * u * u + u * (0.5 - 2.0 * (a - 0.5))
    };
    let found = smoothness_of(|q| waves(lost(q), q[0]), |_, _| 1.0);
    let defocus = found.defocus.expect("they go out of focus");
    let [square, along, by_a, by_b] = defocus.beta;
    // Means of neighbors have 0.85 and 0.93 of the waves, and their curvature 0.95 and 0.98 of what theirs is.
    assert!((4.0..5.2).contains(&square) && (0.5..0.65).contains(&along), "{defocus:?}");
    assert!((-2.6..-1.6).contains(&by_a) && by_b.abs() < 0.2, "{defocus:?}");
    assert_eq!(smoothness_of(|q| waves(0.0, q[0]), |_, _| 1.0).defocus, None);
}

/// Where only ink was but for what is set aside, the field runs away, and tells nothing of what is right elsewhere.
#[test]
fn rays_that_only_ink_has_met_do_not_decide() {
    let wave = |at: f32| 0.5 + 0.5 * (std::f32::consts::TAU * at * 20.0).cos();
    let is_ink =
        |p: usize, [a, b]: [f32; 2]| p % 4 != 1 && (a * 96.0) as usize % 24 < 8 && (b * 96.0) as usize % 24 < 8;
    let light = |p, at| if is_ink(p, at) { 0.02 } else { 1.0 };
    let all = chosen(|[a, _]| [wave(a); 2]);
    let with_ink = chosen_with(|[a, _]| [wave(a); 2], light);
    for (all, ink) in all.iter().zip(&with_ink) {
        assert!((ink[0] / all[0]).ln().abs() < 1.0, "{all:?}, with ink {ink:?}");
    }
}

/// [`Aside::new`] sets the nearest, the middle, and the farthest of a few boards aside, one after the other, where boards
/// are held out in turn; its strips are 32 pixels wide whatever the cells per pixel.
#[test]
fn few_boards_are_set_aside_in_turn() {
    let aside = Aside::new(&[4, 0, 3, 1, 2], true, [500, 400, 1], 2);
    assert_eq!(positions_of(&aside), [[4], [3], [2]]);
    assert_eq!(aside.strips, [[0..500, 168..232], [218..282, 0..400]]);
}
