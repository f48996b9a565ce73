use nelu3d_evaluate::compare;

#[test]
fn comparison_counts_what_only_one_has() {
    let nan = f32::NAN;
    let c = compare(&[1.0, 2.0, nan, 4.0], &[0.5, nan, 3.0, 4.5]);
    assert_eq!((c.n, c.n_only_first, c.n_only_second), (2, 1, 1));
    assert_eq!((c.depth_mm.bias, c.depth_mm.mae), (0.0, 0.5));
}
