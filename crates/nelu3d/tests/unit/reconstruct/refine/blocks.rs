use nelu3d::reconstruct::refine::blocks::Blocks;

#[test]
fn what_is_smooth_is_the_same_in_blocks() {
    let (w, h) = (130, 100);
    let ramp = |i: usize| [(i % w) as f32, 2.0 * (i / w) as f32 - 7.0];
    for side in [1, 4, 10] {
        let blocks = Blocks::new(w, h, side);
        let means = blocks.means(ramp);
        // Between the middles of whole blocks.
        for (x, y) in [(10, 10), (51, 44), (w - 20, h - 20)] {
            let found = blocks.at(&means, [x, y]);
            assert!(found.iter().zip(ramp(y * w + x)).all(|(a, b)| (a - b).abs() < 1e-3), "{side}: {found:?}");
        }
        // And averaged over squares that lie within the map.
        let smooth = blocks.smoothed(&means, 20);
        let middle = blocks.height / 2 * blocks.width + blocks.width / 2;
        let off: [f32; 2] = std::array::from_fn(|j| (smooth[j][middle] - means[middle][j]).abs());
        assert!(off.iter().all(|v| *v < 1e-3), "{side}: {off:?}");
    }
}
