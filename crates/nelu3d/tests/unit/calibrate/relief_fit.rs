use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d::calibrate::BoardPlane;
use nelu3d::calibrate::relief::Relief;
use nelu3d::calibrate::relief_fit::fit_relief;
use nelu3d::calibrate::shared_displacement::SquareDisplacement;

const EXTENT_MM: [f64; 4] = [0.0, 0.0, 600.0, 750.0];

fn boards() -> Vec<BoardPlane> {
    let poses = [
        ([-350.0, -300.0, 3000.0], [0.1, 0.3, 0.0]),
        ([-250.0, -420.0, 3300.0], [-0.3, 0.1, 0.1]),
        ([-320.0, -380.0, 3500.0], [0.2, -0.3, -0.1]),
        ([-280.0, -350.0, 3200.0], [0.05, 0.4, 0.05]),
    ];
    poses.map(|(at, turn)| BoardPlane::new(&Isometry3::new(at.into(), turn.into()), EXTENT_MM, None)).into()
}

/// A board whose corner at (0, 0) stands some 4 mm out, over 300 mm of it.
fn curled() -> Relief {
    let mut relief = Relief::flat(EXTENT_MM);
    // Nodes are cells apart, the first one cell before the outline.
    for (i, height) in relief.nodes.iter_mut().enumerate() {
        let [x, y] = [(i % 11) as f64 - 1.0, (i / 11) as f64 - 1.0].map(|at| at * 75.0);
        *height = -6.0 * (1.0 - x.hypot(y) / 300.0).max(0.0).powi(2);
    }
    relief
}

/// What squares of boards with these reliefs are off by from where flat ones would be, whose poses are wrong by a plane
/// each: in the words of a field that is right.
fn squares(boards: &[BoardPlane], reliefs: &[Relief], seed: usize) -> Vec<SquareDisplacement> {
    let mut state = seed as u32;
    let mut unit = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24)
    };
    let mut all = Vec::new();
    for (p, (board, relief)) in boards.iter().zip(reliefs).enumerate() {
        let mut true_board = *board;
        true_board.add_relief(relief);
        for i in 0..18 * 18 {
            let [u, v] = [i % 18, i / 18].map(|at| (at as f64 - 8.5) * 0.013);
            let dir = Vector3::new(u, v, 1.0).normalize();
            let (Some(flat), Some(t)) = (board.hit(&dir), true_board.hit(&dir)) else { continue };
            let noise = 0.3 * (unit() + unit() + unit() - 1.5);
            let off = t - flat + 0.4 - 3.0 * u + 2.0 * v * p as f64 + noise;
            all.push(SquareDisplacement::new(p, 1 + i % 3, [-off as f32, 0.1], [u, v]));
        }
    }
    all
}

/// Root mean square of a function over the board.
fn rms(of: impl Fn([f64; 2]) -> f64) -> f64 {
    let at = |i: usize| [(i % 20) as f64 * 30.0 + 15.0, (i / 20) as f64 * 37.5 + 18.75];
    ((0..400).map(|i| of(at(i)).powi(2)).sum::<f64>() / 400.0).sqrt()
}

/// A curl is found beside wrong poses and noise, and so is which board was held the other way around.
#[test]
fn a_curled_corner_is_found_and_which_way_around_boards_were_held() {
    let (boards, curled) = (boards(), curled());
    let reliefs = [curled, curled, curled.turned(), curled];
    for (seed, is_symmetric) in [(1, true), (2, true), (3, true), (1, false)] {
        let of_all = if is_symmetric { reliefs } else { [curled; 4] };
        let turned = (!is_symmetric).then_some(&[false; 4][..]);
        let fitted = fit_relief(&boards, turned, &squares(&boards, &of_all, seed)).expect("it shows");
        for (mut true_relief, found) in of_all.into_iter().zip(&fitted.reliefs) {
            // What is a plane of it belongs to the poses.
            true_relief.remove_plane();
            let off = rms(|at| found.height(at) - true_relief.height(at));
            let size = rms(|at| true_relief.height(at));
            assert!(off < 0.35 * size, "seed {seed}: {off} of {size} mm");
        }
    }
}

#[test]
fn flat_boards_stay_flat() {
    let boards = boards();
    for seed in 0..10 {
        let squares = squares(&boards, &[Relief::flat(EXTENT_MM); 4], seed);
        assert!(fit_relief(&boards, (seed % 2 == 0).then_some(&[false; 4]), &squares).is_none(), "{seed}");
    }
}

/// What one board has and another the other way is no relief of all.
#[test]
fn a_corner_that_curls_now_this_way_and_now_that_is_no_relief() {
    let (boards, curled, flat) = (boards(), curled(), Relief::flat(EXTENT_MM));
    let mut backward = curled;
    backward.nodes.iter_mut().for_each(|height| *height = -*height);
    for seed in 0..4 {
        let squares = squares(&boards, &[curled, backward, flat, flat], seed);
        assert!(fit_relief(&boards, Some(&[false; 4]), &squares).is_none(), "{seed}");
    }
}

/// A ray meets the relief over the plane, not the plane.
#[test]
fn rays_meet_a_relief_where_it_is() {
    let pose = Isometry3::new(Vector3::new(-300.0, -300.0, 2500.0), Vector3::new(0.5, -0.6, 0.1));
    let flat = BoardPlane::new(&pose, EXTENT_MM, None);
    let (mut board, curled) = (flat, curled());
    board.add_relief(&curled);
    for plane in [[30.0, 30.0], [90.0, 20.0], [300.0, 300.0]] {
        let on = pose * Point3::new(plane[0], plane[1], curled.height(plane));
        let t = board.hit(&on.coords.normalize()).unwrap();
        assert!((t - on.coords.norm()).abs() < 1e-6, "{plane:?}");
    }
    assert!(curled.height([30.0, 30.0]) < -2.0 && curled.height([450.0, 500.0]) == 0.0);
}
