use nelu3d::color_field::{DepthNoise, SupportedDepthNoise};

#[test]
fn squares_of_any_size_lie_between_those_that_were_measured() {
    let noise = DepthNoise { by_side: [2.0, 4.0, 8.0, 0.5], by_support: Vec::new() };
    for (pixels, expected) in [(0.1, 2.0), (1.0, 2.0), (4.0, 4.0), (8.0, 6.0), (16.0, 8.0), (64.0, 1.0), (1e4, 1.0)] {
        let factor = noise.factor(pixels, Some(3));
        assert!((factor - expected).abs() < 1e-6, "{pixels}: {factor}");
    }
}

#[test]
fn fewer_positions_scatter_more() {
    let by_side = |at: f64| [1.0, 1.0 + 10.0 / at, 1.0 + 20.0 / at, 1.0 + 40.0 / at];
    let by_support = [2.0, 5.0, 20.0].map(|positions| SupportedDepthNoise { positions, by_side: by_side(positions) });
    let noise = DepthNoise { by_side: [9.0; 4], by_support: by_support.to_vec() };
    for (positions, expected) in [(1, 21.0), (2, 21.0), (4, 11.0), (5, 9.0), (10, 5.0), (24, 3.0)] {
        let factor = noise.factor(64.0, Some(positions));
        assert!((factor - expected).abs() < 1e-4, "{positions}: {factor}");
    }
}
