use nelu3d_scan::image::bilinear;

#[test]
fn a_plane_is_interpolated_exactly_and_its_border_goes_on() {
    let plane: Vec<f32> = (0..12).map(|i| (i % 4) as f32 + 10.0 * (i / 4) as f32).collect();
    for (at, expected) in [([1.5, 0.25], 4.0), ([3.0, 2.0], 23.0), ([-5.0, 1.0], 10.0), ([9.0, 9.0], 23.0)] {
        assert_eq!(bilinear(&plane, [4, 3], at), expected, "{at:?}");
    }
    assert_eq!(bilinear(&[7.0], [1, 1], [0.3, -0.2]), 7.0);
}
