use nelu3d::calibrate::binning::binning;

#[test]
fn only_sensors_of_more_pixels_than_a_field_holds_are_binned() {
    assert_eq!(binning(640 * 480, 3), 1);
    assert_eq!(binning(640 * 480, 44), 1);
    assert_eq!(binning(12_000_000, 3), 1);
    assert_eq!(binning(12_000_000, 20), 1);
    assert_eq!(binning(16_000_000, 3), 2);
    assert_eq!(binning(6400 * 4800, 3), 3);
    assert_eq!(binning(6400 * 4800, 44), 3);
    // A single channel leaves room for twelve million cells.
    assert_eq!(binning(6400 * 4800, 1), 1);
}
