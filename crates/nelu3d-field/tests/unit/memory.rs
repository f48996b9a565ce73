//! Large tables lie on pages of their own; those that a caller sees are the moments of their parameters.

use nelu3d_field::adam::MomentBuffers;

/// Bytes of a large page.
const LARGE_PAGE: usize = 1 << 21;

#[test]
fn zeros_of_any_size() {
    for n in [0, 1, 1000, 5 * LARGE_PAGE / 4 + 3] {
        let MomentBuffers { first, second } = MomentBuffers::new(n);
        for mut values in [first, second] {
            assert!(values.len() == n && values.iter().all(|&x| x == 0.0));
            values.fill(1.0);
            assert!(values.iter().all(|&x| x == 1.0));
        }
    }
}
