use nelu3d_scan::pattern::{Axis, Pattern, Xor, decode_xor};

use super::with_inverse;

#[test]
fn no_image_has_wide_stripes() {
    for base_px in [2, 4, 8] {
        let xor = Xor { axis: Axis::X, base_px, inverse: false };
        let [images, _] = with_inverse(Pattern::Xor(xor), 1024, 1).unwrap();
        for (b, image) in images.iter().enumerate() {
            let mut run = 1;
            for u in 1..1024 {
                run = if image.data[u] == image.data[u - 1] { run + 1 } else { 1 };
                assert!(run <= 2 * base_px, "bit {b} of XOR-{base_px:02}");
            }
        }
        let got = decode_xor(&images, &[], base_px, 0.1);
        assert!(got.iter().enumerate().all(|(u, c)| *c == Some(u as u32)));
    }
}

#[test]
fn other_widths_are_refused() {
    for base_px in [0, 1, 3, 2048] {
        assert!(
            with_inverse(Pattern::Xor(Xor { axis: Axis::X, base_px, inverse: false }), 640, 4).is_err(),
            "{base_px}"
        );
    }
    assert!(with_inverse(Pattern::Xor(Xor { axis: Axis::X, base_px: 1024, inverse: false }), 640, 4).is_ok());
}
