use nelu3d_scan::pattern::{Axis, Pattern, Superposition};

use super::images;

#[test]
fn light_adds_up_at_every_pixel() {
    let images = images(Pattern::Superposition(Superposition { axis: Axis::X, stripe_px: 3 }), 40, 2).unwrap();
    assert_eq!(images.len(), Superposition::IMAGES);
    let sums = Superposition::sums();
    assert_eq!(sums.len(), 18);
    for [a, b, both] in sums {
        let sum = images[a].data.iter().zip(&images[b].data).map(|(a, b)| a + b);
        assert!(sum.eq(images[both].data.iter().copied()), "{a} + {b} = {both}");
        assert!(images[a].data.iter().any(|v| *v > 0.0) && images[b].data.iter().any(|v| *v > 0.0));
    }
    let without = Pattern::Superposition(Superposition { axis: Axis::X, stripe_px: 0 });
    assert!(without.generate(40, 2).is_err());
}
