use nelu3d::sensor::Blur;

#[test]
fn no_light_comes_from_far_beyond_the_blur() {
    let blur = Blur::new(0.5);
    assert_eq!(blur.shift([0.2, 0.0]), [0.1, 0.0]);
    let [x, y] = blur.shift([30.0, 40.0]);
    assert!((x.hypot(y) - 1.5 * 0.5f32.sqrt()).abs() < 1e-5 && (y / x - 4.0 / 3.0).abs() < 1e-5);
}

/// A pixel's own area is 1/12 of a square pixel whatever its size; of what the optics blur, blocks of more pixels see
/// less.
#[test]
fn blocks_see_less_of_what_optics_blur() {
    let blur = Blur::of_optics(0.6);
    assert!((blur.variance() - (0.36 + 1.0 / 12.0)).abs() < 1e-6);
    assert!((blur.of_blocks(3).variance() - (0.04 + 1.0 / 12.0)).abs() < 1e-6);
    assert_eq!(blur.of_blocks(1), blur);
}
