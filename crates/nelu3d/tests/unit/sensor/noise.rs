use nelu3d::sensor::{NoiseEstimator, NoiseModel};
use nelu3d_scan::Image;
use rand::{RngExt, SeedableRng};

#[test]
fn finds_declared_noise_under_edges_and_shading() {
    let mut rng = rand::rngs::StdRng::seed_from_u64(1);
    let expected = NoiseModel { read: 4e-6, gain: 1e-4, darkest: None };
    let mut image = Image::new(400, 300, 1);
    for y in 0..300 {
        for x in 0..400 {
            let clean = 0.05 + 0.8 * (x as f32 / 400.0) * if (y / 40) % 2 == 0 { 1.0 } else { 0.3 };
            let n: f32 = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
            image.data[y * 400 + x] = clean + n * expected.variance(clean).sqrt();
        }
    }
    let mut e = NoiseEstimator::default();
    e.add(&image);
    let m = e.finish(1.0 / 4095.0, None);
    for i in [0.1, 0.4, 0.8] {
        let ratio = m.variance(i) / expected.variance(i);
        assert!((0.8..1.25).contains(&ratio), "at {i}: {ratio}");
    }
    // Light as it is, and as cameras for people deliver it.
    let growth = e.growth(1.0 / 4095.0).unwrap();
    let shot = f64::from(expected.variance(0.75) / expected.variance(0.2));
    assert!((0.8..1.25).contains(&(growth / shot)), "{growth}, not {shot}");
    image.data.iter_mut().for_each(|v| *v = v.max(0.0).powf(1.0 / 2.2));
    let mut e = NoiseEstimator::default();
    e.add(&image);
    let growth = e.growth(1.0 / 255.0).unwrap();
    assert!((0.2..0.7).contains(&growth), "{growth}");
    assert_eq!(NoiseEstimator::default().growth(1.0 / 255.0), None);
}

/// What is dark has a third of its noise's variance where the sensor cannot tell less than zero: the noise that is found
/// is that of the sensor.
#[test]
fn noise_is_what_it_was_before_clipping() {
    let mut rng = rand::rngs::StdRng::seed_from_u64(3);
    let expected = NoiseModel { read: 1.8e-6, gain: 1.7e-4, darkest: Some(0.0) };
    let mut e = NoiseEstimator::default();
    for _ in 0..4 {
        let mut image = Image::new(400, 300, 1);
        for (i, v) in image.data.iter_mut().enumerate() {
            let clean = 0.2 * ((i % 400) as f32 / 400.0 - 0.4).max(0.0);
            let n: f32 = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
            let code = 1023.0 * (clean + n * expected.variance(clean).sqrt());
            *v = code.round().max(0.0) / 1023.0;
        }
        e.add(&image);
    }
    let [clipped, found] = [None, Some(0.0)].map(|darkest| e.finish(1.0 / 1023.0, darkest));
    assert_eq!(found.darkest, Some(0.0));
    assert!((0.8..1.25).contains(&(found.read / expected.read)), "{found:?}");
    assert!((0.8..1.25).contains(&(found.gain / expected.gain)), "{found:?}");
    assert!(clipped.read < 0.6 * expected.read, "{clipped:?}");
}

/// Between black and white, a Gray code has nothing but the edges of stripes.
#[test]
fn edges_are_not_noise() {
    let mut rng = rand::rngs::StdRng::seed_from_u64(2);
    let mut image = Image::new(400, 300, 1);
    for y in 0..300 {
        for x in 0..400 {
            // Stripes of 20 px that are not quite upright, with edges of 2 px and feet of 5 % light.
            let phase = (x as f32 + 0.3 * y as f32 + 3.0 * (y as f32 / 9.0).sin()) % 20.0;
            let lit = (phase / 2.0).clamp(0.0, 1.0) * ((12.0 - phase) / 2.0).clamp(0.0, 1.0);
            let clean = 0.04 + 0.7 * lit;
            let n: f32 = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
            image.data[y * 400 + x] = clean + n * (1e-6 + 1e-5 * clean).sqrt();
        }
    }
    let mut e = NoiseEstimator::default();
    e.add(&image);
    assert_eq!(e.growth(1.0 / 4095.0), None);
}
