use nelu3d_scan::pattern::{Axis, Pattern, Ramp};

use super::images;

#[test]
fn the_value_is_the_column() {
    let image = &images(Pattern::Ramp(Ramp { axis: Axis::X }), 641, 2).unwrap()[0];
    for u in 0..641 {
        assert!((image.pixel(u, 1)[0] * 640.0 - u as f32).abs() < 1e-3);
    }
    assert_eq!(images(Pattern::Ramp(Ramp { axis: Axis::Y }), 2, 5).unwrap()[0].pixel(1, 4), [1.0]);
}
