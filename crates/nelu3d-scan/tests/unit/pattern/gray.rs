use nelu3d_scan::pattern::{Axis, Gray, Pattern, decode_gray};

use super::with_inverse;

#[test]
fn patterns_decode_to_their_columns() {
    for (axis, n) in [(Axis::X, 1), (Axis::X, 2), (Axis::X, 3), (Axis::X, 640), (Axis::Y, 801), (Axis::Y, 1024)] {
        let (w, h) = if axis == Axis::X { (n, 3) } else { (3, n) };
        let [images, inverse] = with_inverse(Pattern::Gray(Gray { axis, inverse: true }), w, h).unwrap();
        assert!(images.len() == (n.max(2) as f64).log2().ceil() as usize);
        for inverse in [inverse.as_slice(), &[]] {
            let got = decode_gray(&images, inverse, 0.1);
            for (i, code) in got.iter().enumerate() {
                let expected = if axis == Axis::X { i % w } else { i / w };
                assert_eq!(*code, Some(expected as u32), "{n} along {axis:?}");
            }
        }
    }
}

#[test]
fn neighbors_differ_in_one_bit() {
    let [images, _] = with_inverse(Pattern::Gray(Gray { axis: Axis::X, inverse: false }), 1000, 1).unwrap();
    for u in 1..1000 {
        assert_eq!(images.iter().filter(|i| i.data[u] != i.data[u - 1]).count(), 1);
    }
}
