use nelu3d_scan::pattern::{Axis, Pattern, Triangle};

use super::images;

#[test]
fn columns_come_back_within_half_a_period() {
    let image = &images(Pattern::Triangle(Triangle { axis: Axis::X, period_px: 50.0 }), 120, 1).unwrap()[0];
    for u in 0..=25 {
        assert!((f64::from(image.pixel(u, 0)[0]) * 25.0 - u as f64).abs() < 1e-5);
        assert_eq!(image.pixel(u, 0), image.pixel(50 - u, 0));
        assert!((image.pixel(u, 0)[0] - image.pixel(u + 50, 0)[0]).abs() < 1e-6);
    }
}
