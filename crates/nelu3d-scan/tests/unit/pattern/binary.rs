use nelu3d_scan::pattern::{Axis, Binary, Pattern, decode_binary};

use super::with_inverse;

#[test]
fn the_first_image_halves_the_columns() {
    let [images, inverse] = with_inverse(Pattern::Binary(Binary { axis: Axis::X, inverse: true }), 256, 1).unwrap();
    assert_eq!((images.len(), inverse.len()), (8, 8));
    for u in 0..256 {
        assert_eq!(images[0].data[u], if u < 128 { 0.0 } else { 1.0 });
        assert_eq!(images[7].data[u], (u % 2) as f32);
        assert_eq!(images[7].data[u] + inverse[7].data[u], 1.0);
    }
    assert_eq!(decode_binary(&images, &inverse, 0.1)[77], Some(77));
}
