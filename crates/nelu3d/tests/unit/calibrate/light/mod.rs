mod center;
mod disagreement;
mod transport;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d::calibrate::BoardPlane;
use nelu3d::calibrate::light::center::Chart;
use nelu3d::calibrate::light::find_center;
use nelu3d::calibrate::light::search::different;
use nelu3d::calibrate::light::transport::{Seed, Transport, partner, seeds};
use nelu3d::calibrate::views::{Level, Views};
use nelu3d::progress::Progress;
use nelu3d_scan::Camera;

/// Views of boards held by hand under a light at `center` whose rays have the codeword `code(x, y)` at tangents x
/// and y.
fn views(camera: &Camera, poses: &[Isometry3<f64>], center: Point3<f64>, code: impl Fn(f64, f64) -> Vec<f32>) -> Views {
    views_on_paper(camera, poses, center, code, |_, _| true)
}

/// Views of boards held by hand under a light at `center` whose rays have the codeword `code(x, y)` at tangents x and
/// y. Usable are pixels x, y that show paper.
fn views_on_paper(
    camera: &Camera,
    poses: &[Isometry3<f64>],
    center: Point3<f64>,
    code: impl Fn(f64, f64) -> Vec<f32>,
    is_paper: impl Fn(usize, usize) -> bool,
) -> Views {
    let k = code(0.0, 0.0).len();
    let mut finest = Level::finest(camera, k, poses.len());
    let boards: Vec<_> =
        poses.iter().map(|p| BoardPlane::new(p, [-90.0, -70.0, 90.0, 70.0], None)).enumerate().collect();
    for (_, board) in &boards {
        let mut image = Vec::new();
        for i in 0..camera.n_pixels() {
            let dir = camera.ray([(i % camera.width) as f64, (i / camera.width) as f64]).dir;
            let values = board.hit(&dir).map(|t| {
                let from = Point3::from(dir * t) - center;
                code(from.x / from.z, from.y / from.z)
            });
            let values = values.filter(|_| is_paper(i % camera.width, i / camera.width));
            let usable = if values.is_some() { 1.0 } else { 0.0 };
            image.extend(values.unwrap_or_else(|| vec![0.0; k]));
            image.push(usable);
        }
        finest.images.push(image);
    }
    Views::new(k, boards, finest, &Vector3::z())
}

fn poses() -> Vec<Isometry3<f64>> {
    let tilts = [[0.2, -0.1, 0.0], [-0.25, 0.1, 0.05], [0.05, 0.3, 0.0], [0.1, -0.3, -0.05], [-0.1, 0.05, 0.1]];
    let places = [[5.0, 0.0, 760.0], [-10.0, 8.0, 640.0], [12.0, -6.0, 700.0], [0.0, 4.0, 735.0], [-4.0, -9.0, 668.0]];
    (0..5).map(|i| Isometry3::new(Vector3::from(places[i]), Vector3::from(tilts[i]))).collect()
}

/// Gray code of a tangent, 7 bits.
fn gray(v: f64) -> impl Iterator<Item = f32> {
    let n = (((v + 0.6) / 1.2).clamp(0.0, 0.999) * 128.0) as u32;
    (0..7).map(move |bit| ((n ^ n >> 1) >> bit & 1) as f32)
}

#[test]
fn starts_that_end_in_the_same_place_are_one() {
    let states = [[0.1, 0.2, 0.3], [0.1004, 0.2, 0.2998], [0.1, 0.21, 0.3], [0.1, 0.2101, 0.3]];
    assert_eq!(different(states.to_vec()), [states[0], states[2]]);
}

#[test]
fn carried_codewords_have_the_slopes_of_differences() {
    let mut camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
    camera.distortion = nelu3d_scan::camera::Distortion::new(&[-0.2, 0.1, 1e-3, -2e-3, 0.0]).unwrap();
    let wave = |v: f64| (40.0 * v).sin() as f32;
    let views = views(&camera, &poses(), Point3::new(-60.0, 140.0, 55.0), |x, y| vec![wave(x), wave(y)]);
    let chart = Chart::new(Point3::new(5.0, -3.0, 700.0));
    let t = Transport { camera: &camera, views: &views, chart: &chart };
    let state = [-0.1, 0.2, 0.9];
    let at = |i: usize, h: f64| {
        let mut s = state;
        s[i] += h;
        chart.center(s)
    };
    const H: f64 = 1e-7;
    let (mut n, mut apart) = (0, 0);
    for level in &views.levels[..2] {
        for seed in seeds(&camera, &views, level, 2000) {
            let to = (seed.view + 1) % views.count();
            let mut rows = Vec::new();
            t.carry_with_slopes(level, &[seed], (&chart.center(state), &chart.slopes(state)), |_| to, &mut rows);
            let mut here = [0.0; 2];
            assert_eq!(t.carry(level, &seed, &chart.center(state), to, &mut here), !rows.is_empty());
            for i in 0..3 {
                let (mut more, mut less) = ([0.0; 2], [0.0; 2]);
                let both =
                    t.carry(level, &seed, &at(i, H), to, &mut more) && t.carry(level, &seed, &at(i, -H), to, &mut less);
                for (c, row) in rows.iter().enumerate().filter(|_| both) {
                    assert_eq!(row.difference, here[c]);
                    let slope = (more[c] - less[c]) / (2.0 * H);
                    n += 1;
                    // Where the step crosses into the next pixel, there are two slopes.
                    apart += usize::from((row.there[i] - slope).abs() > 1e-5 * (1.0 + slope.abs()));
                }
            }
        }
    }
    assert!(n > 10_000 && apart * 1000 < n, "{apart} of {n}");
}

#[test]
fn slopes_here_and_there_are_the_same_under_the_right_light() {
    let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
    let center = Point3::new(-60.0, 140.0, 55.0);
    let wave = |v: f64| (20.0 * v).sin() as f32;
    let views = views(&camera, &poses(), center, |x, y| vec![wave(x), wave(y)]);
    let chart = Chart::new(Point3::new(5.0, -3.0, 700.0));
    let t = Transport { camera: &camera, views: &views, chart: &chart };
    let state = chart.state(&center).unwrap();
    let mut rows = Vec::new();
    let all = seeds(&camera, &views, &views.levels[0], 4000);
    let to = |seed: &Seed| (seed.view + 1) % views.count();
    t.carry_with_slopes(&views.levels[0], &all, (&chart.center(state), &chart.slopes(state)), to, &mut rows);
    let both: Vec<_> = rows.iter().filter_map(|r| Some((r.there, r.here?))).collect();
    assert!(both.len() > 2000, "{}", both.len());
    for i in 0..3 {
        let sum = |f: &dyn Fn(f64, f64) -> f64| both.iter().map(|(t, h)| f(t[i], h[i])).sum::<f64>();
        let (there, here, product) = (sum(&|t, _| t * t), sum(&|_, h| h * h), sum(&|t, h| t * h));
        assert!(product > 0.99 * (there * here).sqrt(), "{i}: {there} {here} {product}");
        assert!((product / there - 1.0).abs() < 0.03, "{i}: {there} {here} {product}");
    }
}

#[test]
fn a_few_boards_held_by_hand_tell_where_the_light_is() {
    let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
    let center = Point3::new(-60.0, 140.0, 55.0);
    let both = views(&camera, &poses(), center, |x, y| gray(x).chain(gray(y)).collect());
    let found = find_center(both, &camera, &Progress::none()).unwrap();
    let at = found.center.position().unwrap();
    assert!((at - center).norm() < 6.0 && found.center.line.is_none(), "{at}");
    assert!(found.without_consensus.is_empty());

    // Along one axis only: up to a line along y.
    let rows = views(&camera, &poses(), center, |x, _| gray(x).collect());
    let found = find_center(rows, &camera, &Progress::none()).unwrap();
    let (at, line) = (found.center.position().unwrap(), found.center.line.unwrap());
    assert!(line.y.abs() > 0.95, "{line}");
    let off = (at - center) - line * line.dot(&(at - center));
    assert!(off.norm() < 8.0, "{at} {line}");
    // Of that line, the point nearest to the camera.
    assert!(line.dot(&at.coords).abs() < 80.0, "{at} {line}");
}

/// Under three slow waves with noise, codewords of two boards at a time tell the light's center to 4.4 mm; those of all
/// boards, against the field that they share, to 0.8 mm or better.
#[test]
fn all_boards_together_tell_the_light_better_than_pairs() {
    let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
    let center = Point3::new(-160.0, 20.0, 55.0);
    let state = std::cell::Cell::new(7u64);
    let unit = || {
        state.set(state.get().wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407));
        (state.get() >> 40) as f32 / (1u64 << 24) as f32
    };
    let noise = || 0.04 * (unit() + unit() + unit() - 1.5);
    let wave = |v: f64, f: f64| 0.5 + 0.5 * (f * v).sin() as f32 + noise();
    let noisy = views(&camera, &poses(), center, |x, y| vec![wave(x, 21.0), wave(x, 33.0), wave(y, 25.0)]);
    let found = find_center(noisy, &camera, &Progress::none()).unwrap();
    let off = found.center.position().unwrap() - center;
    assert!(off.norm() < 1.2, "{off}");
}

/// Paper in specks, on which one sample in forty lands that is carried from another board, and none of the first ones:
/// the right center has the lower score where it is worked out to the end.
#[test]
fn boards_of_much_ink_score_the_right_light_best() {
    let camera = Camera::pinhole(640, 480, 2133.0, 2133.0, 319.5, 239.5);
    let center = Point3::new(-60.0, 140.0, 55.0);
    // Squares of four pixels, one of sixteen.
    let square = |x: usize, y: usize| (x / 4).wrapping_mul(1_000_003) ^ (y / 4).wrapping_mul(7919);
    let is_speck = |x: usize, y: usize| (square(x, y).wrapping_mul(2_654_435_761) >> 7) % 16 == 0;
    let code = |x, y| gray(x).chain(gray(y)).collect();
    let views = views_on_paper(&camera, &poses(), center, code, is_speck);
    let chart = Chart::new(Point3::new(5.0, -3.0, 700.0));
    let t = Transport { camera: &camera, views: &views, chart: &chart };
    let level = &views.levels[0];
    let score = |at: Point3<f64>, give_up: Option<f64>| {
        let state = chart.state(&at).unwrap();
        let light = chart.center(state);
        let lands = |seed: &Seed| t.carry(level, seed, &light, partner(seed, 2, 5), &mut [0.0; 14]);
        let mut all = seeds(&camera, &views, level, 4000);
        all.sort_by_key(lands);
        let n = all.iter().filter(|seed| lands(seed)).count();
        assert!((all.len() / 60..all.len() / 25).contains(&n), "{n} of {}", all.len());
        // Two samples of fourteen bits that were drawn by chance.
        t.score(level, &all, state, 2, 7.0, give_up)
    };
    let (right, wrong) = (score(center, None), score(center + Vector3::new(40.0, -30.0, 20.0), None));
    assert!(right < 0.4 && wrong > right + 0.1, "{right} {wrong}");
    assert!(score(center, Some(0.85)) > 1.0);
}

#[test]
fn a_position_that_does_not_fit_is_named() {
    let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
    let center = Point3::new(-60.0, 140.0, 55.0);
    let mut wrong = views(&camera, &poses(), center, |x, y| gray(x).chain(gray(y)).collect());
    // Taken for 40 mm nearer than it was.
    wrong.planes[2].1 -= 40.0;
    let position = wrong.positions[2];
    let found = find_center(wrong, &camera, &Progress::none()).unwrap();
    assert_eq!(found.without_consensus, [position]);
    let at = found.center.position().unwrap();
    assert!((at - center).norm() < 6.0, "{at}");
}

#[test]
fn a_hand_before_a_board_is_left_out() {
    let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
    let center = Point3::new(-60.0, 140.0, 55.0);
    let code = |x: f64, y: f64| gray(x).chain(gray(y)).collect::<Vec<f32>>();
    let clean = views(&camera, &poses(), center, code);
    let k = clean.k;
    // 36 × 30 pixels of the second view show what the light throws 25 mm before the board.
    let mut with_hand = views(&camera, &poses(), center, code);
    let hidden = 1;
    let (normal, offset) = with_hand.planes[hidden];
    let is_hand = |x: usize, y: usize| (60..96).contains(&x) && (70..100).contains(&y);
    for i in (0..camera.n_pixels()).filter(|i| is_hand(i % 240, i / 240)) {
        let dir = camera.ray([(i % 240) as f64, (i / 240) as f64]).dir;
        let from = Point3::from(dir * (offset / normal.dot(&dir) - 25.0)) - center;
        with_hand.levels[0].images[hidden][i * (k + 1)..][..k].copy_from_slice(&code(from.x / from.z, from.y / from.z));
    }
    let levels = with_hand.levels.len();
    let finest = with_hand.levels.swap_remove(0);
    let boards: Vec<_> = with_hand
        .positions
        .iter()
        .map(|p| (*p, BoardPlane::new(&poses()[*p], [-90.0, -70.0, 90.0, 70.0], None)))
        .collect();
    let with_hand = Views::new(k, boards, finest, &Vector3::z());
    assert_eq!(with_hand.levels.len(), levels);
    let position = with_hand.positions[hidden];

    let none = find_center(clean, &camera, &Progress::none()).unwrap();
    assert!(none.excluded.is_empty(), "{:?}", none.excluded.iter().map(|e| e.0).collect::<Vec<_>>());
    let found = find_center(with_hand, &camera, &Progress::none()).unwrap();
    assert_eq!(found.excluded.iter().map(|e| e.0).collect::<Vec<_>>(), [position]);
    let blocks = &found.excluded[0].1;
    let (mut inside, mut outside) = (0, 0);
    for i in (0..camera.n_pixels()).filter(|i| blocks.contains(i % 240, i / 240)) {
        let near = (50..106).contains(&(i % 240)) && (60..110).contains(&(i / 240));
        if is_hand(i % 240, i / 240) {
            inside += 1
        } else if !near {
            outside += 1
        }
    }
    assert!(inside > 36 * 30 * 9 / 10 && outside < 36 * 30 / 2, "{inside} {outside}");
}
