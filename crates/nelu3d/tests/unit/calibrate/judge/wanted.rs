use nelu3d::calibrate::judge::wanted::{ACROSS, Ray, choose, named};

/// Rays over the whole picture; `depths` by where they are.
fn rays(depths: impl Fn([f64; 2]) -> Vec<f64>) -> Vec<Ray> {
    let at = |i: usize| (i as f64 + 0.5) / ACROSS as f64;
    let all = (0..ACROSS * ACROSS).map(|i| [at(i % ACROSS), at(i / ACROSS)]);
    all.map(|place| Ray { place, depths: depths(place) }).filter(|r| !r.depths.is_empty()).collect()
}

#[test]
fn the_gap_in_depth_is_named() {
    let found = choose(rays(|_| vec![600.0, 620.0, 800.0]), 3);
    assert!((found[0].depth_mm - 700.0).abs() < 21.0, "{found:?}");
    assert!(named(&found).starts_with("at about 7") && !named(&found).contains("picture"), "{}", named(&found));
}

#[test]
fn the_part_of_the_picture_with_one_board_is_named() {
    // Two boards on the left two thirds, one on the right.
    let found = choose(
        rays(|[x, y]| match (x < 0.6, (0.3..0.7).contains(&y)) {
            (true, true) => vec![600.0, 700.0, 800.0, 650.0],
            (false, true) => vec![700.0],
            _ => vec![],
        }),
        4,
    );
    assert!(found[0].place[0].unwrap() > 0.6, "{found:?}");
    assert!(named(&found[..1]).contains("on the right of the picture"), "{}", named(&found));
}

#[test]
fn boards_of_one_depth_want_nothing_in_particular() {
    assert!(choose(rays(|_| vec![600.0]), 1).is_empty());
}
