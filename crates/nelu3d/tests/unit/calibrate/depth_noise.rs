use nelu3d::calibrate::depth_noise::DepthNoiseOfPosition;
use nelu3d::color_field::LEAST_MODEL_SIGMA;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Noise that pixels do not share scatters depth by as much as its level says, whatever that is; displacements that
/// squares of 4 × 4 pixels share, by more the more pixels are averaged; and what all pixels share, not at all.
#[test]
fn what_neighbors_share_is_told_from_noise() {
    let (size, k) = ([480, 320], 3);
    let mut rng = rand::rngs::StdRng::seed_from_u64(5);
    let mut normal = move || -> f32 { StandardNormal.sample(&mut rng) };
    // Noise that is modeled, its level, displacements of squares, and of all.
    let mut measured = |sigma: f32, level: f32, of_squares: f32, of_all: f32| {
        let mut tiles = DepthNoiseOfPosition::new(size, 0, 1);
        let squares: Vec<f32> = (0..120 * 80).map(|_| of_squares * normal()).collect();
        for i in 0..size[0] * size[1] {
            assert!(tiles.wants(i));
            let moved = squares[i / size[0] / 4 * 120 + i % size[0] / 4] + of_all;
            // One channel after the other has a slope, as in a Gray code.
            let slopes: Vec<f32> = (0..k).map(|j| if j == i % k { 0.5 } else { 0.0 }).collect();
            let errors: Vec<f32> = slopes.iter().map(|d| d * moved + level * sigma * normal()).collect();
            tiles.add(i, |j| errors[j], &slopes, &vec![1.0 / (sigma * sigma); k], 1);
        }
        tiles.finish().depth_noise(LEAST_MODEL_SIGMA).unwrap().by_side
    };
    for level in [1.0, 2.0] {
        let noise = measured(0.02, level, 0.0, 3.0);
        // Of few squares in a tile, the largest are taken for gross errors.
        assert!(noise.iter().all(|v| (0.8..1.1).contains(v)), "{level}: {noise:?}");
    }
    // Displacements as large as a pixel's noise in depth.
    let shared = measured(0.02, 1.0, 0.04, 0.0);
    let chi2 = 1.0 + 1.0 / 3.0;
    for (found, expected) in shared.iter().zip([2.0, 5.0, 17.0, 17.0]) {
        assert!((0.75..1.15).contains(&(found * chi2 / expected)), "{shared:?}");
    }
}

/// Where few positions support the field, its own errors are larger.
#[test]
fn errors_are_told_by_the_number_of_positions() {
    let size = [480, 320];
    let mut rng = rand::rngs::StdRng::seed_from_u64(6);
    let mut normal = move || -> f32 { StandardNormal.sample(&mut rng) };
    let mut tiles = DepthNoiseOfPosition::new(size, 0, 1);
    let squares: Vec<f32> = (0..120 * 80).map(|_| 0.04 * normal()).collect();
    for i in 0..size[0] * size[1] {
        let (x, y) = (i % size[0], i / size[0]);
        let (support, moved) = if x < 240 { (2, squares[y / 4 * 120 + x / 4]) } else { (20, 0.0) };
        let errors: Vec<f32> = (0..3).map(|j| if j == i % 3 { 0.5 * moved } else { 0.0 } + 0.02 * normal()).collect();
        let slopes: Vec<f32> = (0..3).map(|j| if j == i % 3 { 0.5 } else { 0.0 }).collect();
        tiles.add(i, |j| errors[j], &slopes, &[2500.0; 3], support);
    }
    let noise = tiles.finish().depth_noise(LEAST_MODEL_SIGMA).unwrap();
    let [few, many] = [2, 20].map(|n| noise.factor(16.0, Some(n)));
    assert!(few > 8.0 && many < 1.3, "{few} {many}: {noise:?}");
    assert!(noise.factor(16.0, Some(6)) < 0.5 * few, "{noise:?}");
}

#[test]
fn too_few_tiles_tell_nothing_and_no_errors_neither() {
    let mut tiles = DepthNoiseOfPosition::new([64, 32], 0, 1);
    (0..64 * 32).for_each(|i| tiles.add(i, |_| 0.01, &[1.0, 0.5], &[100.0, 100.0], 1));
    assert!(tiles.finish().depth_noise(0.01).is_none());
    let mut tiles = DepthNoiseOfPosition::new([480, 320], 0, 1);
    (0..480 * 320).for_each(|i| tiles.add(i, |_| 0.0, &[1.0, 0.5], &[100.0, 100.0], 1));
    assert!(tiles.finish().depth_noise(0.01).is_none());
}
