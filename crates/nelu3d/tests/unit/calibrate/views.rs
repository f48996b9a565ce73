use nelu3d::calibrate::Position;
use nelu3d::calibrate::views::{Level, MAX_VIEWS, VIEWS_BUDGET, selection, smoothed};
use nelu3d_scan::Camera;

#[test]
fn the_selection_is_bounded_even_and_has_both_ends() {
    assert_eq!(selection(5), [0, 1, 2, 3, 4]);
    for n in [49, 60, 96, 1000] {
        let s = selection(n);
        assert_eq!((s.len(), s[0], s[MAX_VIEWS - 1]), (MAX_VIEWS, 0, n - 1));
        let step = (n - 1) as f64 / (MAX_VIEWS - 1) as f64;
        assert!(s.windows(2).all(|w| w[1] > w[0] && ((w[1] - w[0]) as f64 - step).abs() < 1.0), "{s:?}");
    }
}

#[test]
fn views_stay_within_their_budget_whatever_the_camera() {
    let camera = Camera::pinhole(640, 480, 800.0, 800.0, 320.0, 240.0);
    assert_eq!(Level::finest(&camera, 3, MAX_VIEWS).block, 1);
    let large = Camera::pinhole(6400, 4800, 8000.0, 8000.0, 3200.0, 2400.0);
    let v = Level::finest(&large, 11, MAX_VIEWS);
    assert!(v.block > 1 && v.width * v.height * 12 * 4 * MAX_VIEWS <= VIEWS_BUDGET);
}

#[test]
fn smoothing_keeps_planes_and_knows_holes() {
    let (width, height) = (12, 11);
    let values = (0..width * height).map(|i| (i % width) as f32 * 0.02 + (i / width) as f32 * 0.03).collect();
    let mut contrast = vec![0.5; width * height];
    contrast[5 * width + 9] = 0.0;
    let around = contrast.clone();
    let edge = vec![0.0; contrast.len()];
    let position = Position { width, height, k: 1, channels: 1, values, contrast, light: Vec::new(), around, edge };
    let out = smoothed(&position, |_| true, 1);
    let at = |x: usize, y: usize| &out[(y * width + x) * 2..][..2];
    assert!((at(4, 5)[0] - (4.0 * 0.02 + 5.0 * 0.03)).abs() < 1e-6 && (at(4, 5)[1] - 1.0).abs() < 1e-6);
    // Within two pixels of the hole, the validity says so; the border has none.
    assert!(at(8, 5)[1] < 0.99 && at(7, 5)[1] < 0.999 && (at(6, 5)[1] - 1.0).abs() < 1e-6);
    assert!(at(4, 1)[1] == 0.0 && at(1, 5)[1] == 0.0);
}
