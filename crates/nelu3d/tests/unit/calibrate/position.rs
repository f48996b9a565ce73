use nelu3d::calibrate::position::PositionBuilder;
use nelu3d::sensor::NoiseModel;
use nelu3d_scan::Image;

fn image(v: [f32; 4]) -> Image {
    Image { width: 2, height: 2, channels: 1, data: v.to_vec() }
}

#[test]
fn normalizes_and_marks_unusable_pixels() {
    let mut b = PositionBuilder::new(&image([0.5, 0.5, 0.015, 1.0]), image([0.1, 0.0, 0.0, 0.0]), 2, 0.02, None);
    b.add(&image([0.3, 0.25, 0.01, 0.2]));
    b.add(&image([0.1, 1.0, 0.01, 0.2]));
    let p = b.finish();
    assert!((p.values[0] - 0.5).abs() < 1e-6);
    assert_eq!(p.values[1], 0.0);
    let usable: Vec<bool> = p.contrast.iter().map(|c| *c > 0.0).collect();
    assert_eq!(usable, [true, false, false, false]);
    let mut w = [9.0; 2];
    let noise = NoiseModel { read: 1e-4, gain: 0.0, darkest: None };
    assert_eq!(p.sample(0, &noise, &mut w).unwrap().len(), 2);
    // Contrast 0.4, L = 0.5: variance (1 + ¼ + ¼) 1e-4 / 0.16.
    assert!((w[0] - 0.16 / 1.5e-4).abs() < 1.0, "{w:?}");
    assert!(p.sample(1, &noise, &mut w).is_none());
    // In means all values of a pixel count alike.
    p.weights_in_means(0, &noise, &mut w);
    assert!((w[0] - 0.16 / 1.5e-4).abs() < 1.0 && w[1] == w[0], "{w:?}");
    p.weights_in_means(1, &noise, &mut w);
    assert_eq!(w, [0.0; 2]);
}

#[test]
fn ink_tells_less_than_its_noise_says() {
    let mut data = vec![0.8; 64 * 64];
    data[20 * 64 + 20] = 0.05;
    let white = Image { width: 64, height: 64, channels: 1, data };
    let mut b = PositionBuilder::new(&white, Image::new(64, 64, 1), 1, 0.02, None);
    b.add(&Image { data: white.data.iter().map(|v| 0.5 * v).collect(), ..white.clone() });
    let (p, noise, mut w) = (b.finish(), NoiseModel { read: 1e-6, gain: 0.0, darkest: None }, [0.0]);
    p.sample(21 * 64 + 20, &noise, &mut w);
    assert!((w[0] - 0.64 / 1.5e-6).abs() < 1e3, "paper has no more than noise: {w:?}");
    p.sample(20 * 64 + 20, &noise, &mut w);
    // 3 % of sixteen times its own light, less what paper may have.
    assert!((1.0 / w[0] - (0.03f32 * 14.0).powi(2)).abs() < 0.02, "{w:?}");
}

/// A pixel on the edge of ink, of which ink covers seven tenths.
#[test]
fn on_an_edge_of_ink_a_sample_is_of_the_paper_beside() {
    let (w, data) = (64, |x: usize| [0.8, 0.8, 0.28, 0.04][x.saturating_sub(28).min(3)]);
    let white = Image { width: w, height: w, channels: 1, data: (0..w * w).map(|i| data(i % w)).collect() };
    let mut b = PositionBuilder::new(&white, Image::new(w, w, 1), 1, 0.02, None);
    b.add(&Image { data: white.data.iter().map(|v| 0.5 * v).collect(), ..white.clone() });
    let p = b.finish();
    let sd = |x: usize| p.edge[20 * w + x].sqrt();
    assert!(sd(20) == 0.0 && sd(40) == 0.0, "paper and ink have no edge: {} {}", sd(20), sd(40));
    assert!(sd(29) < 0.02, "paper beside an edge: {}", sd(29));
    // A quarter of half the difference of its neighbors over its own contrast.
    assert!((sd(30) - 0.25 * 0.5 * 0.76 / 0.28).abs() < 1e-3, "{}", sd(30));
    assert!(sd(31) > 0.5, "ink beside an edge has the light of paper: {}", sd(31));
}

#[test]
fn a_block_is_what_a_larger_pixel_measures() {
    let mut b = PositionBuilder::new(&image([0.5, 0.3, 0.1, 0.9]), image([0.0; 4]), 1, 0.02, None);
    b.add(&image([0.5, 0.0, 0.1, 0.0]));
    let p = b.finish().reduced(2);
    assert_eq!((p.width, p.height), (1, 1));
    assert!((p.values[0] - 0.6 / 1.8).abs() < 1e-6 && (p.contrast[0] - 0.45).abs() < 1e-6);
    let mut b = PositionBuilder::new(&image([0.5, 0.3, 0.1, 0.9]), image([0.0; 4]), 1, 0.02, None);
    b.add(&image([0.5, 1.0, 0.1, 0.0]));
    assert_eq!(b.finish().reduced(2).contrast, [0.0]);
}
