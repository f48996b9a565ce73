use nelu3d::sensor::BlockDetector;
use nelu3d_scan::Image;

#[test]
fn blocks_are_told_from_noise_and_from_mosaics() {
    let mut state = 1u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.004 * ((state >> 33) as f32 / (1u64 << 30) as f32 - 1.0)
    };
    let mut plain = Image::new(160, 160, 1);
    plain.data.iter_mut().for_each(|v| *v = 0.4 + noise());
    let excess = |image: &Image| {
        let (mut all, mut d) = (BlockDetector::default(), BlockDetector::default());
        d.add(image);
        all.merge(&d);
        all.excess()
    };
    assert!(excess(&plain) < 1.05, "{}", excess(&plain));
    let mut mosaic = plain.clone();
    (0..160 * 160).filter(|i| i % 2 == 1).for_each(|i| mosaic.data[i] = mosaic.data[i - 1]);
    assert!(excess(&mosaic) < 1.05, "{}", excess(&mosaic));
    // Each block is smooth, and a little off its neighbors.
    let mut blocks = plain.clone();
    for i in 0..160 * 160 {
        let block = (i % 160 / 8 * 7 + i / 160 / 8 * 13) % 5;
        blocks.data[i] = 0.4 + 0.0015 * block as f32 + 0.3 * (plain.data[i] - 0.4);
    }
    assert!(excess(&blocks) > 1.3, "{}", excess(&blocks));
}
