use nelu3d::sensor::Blur;

#[test]
fn no_light_comes_from_far_beyond_the_blur() {
    let blur = Blur::new(0.5);
    assert_eq!(blur.shift([0.2, 0.0]), [0.1, 0.0]);
    let [x, y] = blur.shift([30.0, 40.0]);
    assert!((x.hypot(y) - 1.5 * 0.5f32.sqrt()).abs() < 1e-5 && (y / x - 4.0 / 3.0).abs() < 1e-5);
}
