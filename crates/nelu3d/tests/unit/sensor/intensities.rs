use nelu3d::calibrate::position::PositionBuilder;
use nelu3d::sensor::{Intensities, Measurements, NoiseModel};
use nelu3d_scan::Image;
use nelu3d_scan::rig::Capture;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// A webcam in dim light: white is a thousand electrons, an eighth of the scale; no light is no offset, so that noise
/// below it is clipped.
const NOISE: NoiseModel = NoiseModel { read: 1e-6, gain: 1.25e-4, darkest: Some(0.0) };
const WHITE: f32 = 0.1255;
const BLACK: f32 = 5e-4;
/// Normalized intensities of three patterns.
const PATTERNS: [f32; 3] = [0.01, 0.3, 0.97];
const SIDE: usize = 300;

fn measured(clean: f32, rng: &mut StdRng) -> f32 {
    let normal: f32 = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
    (clean + normal * NOISE.variance(clean).sqrt()).max(0.0)
}

fn image(clean: f32, rng: &mut StdRng) -> Image {
    Image { width: SIDE, height: SIDE, channels: 1, data: (0..SIDE * SIDE).map(|_| measured(clean, rng)).collect() }
}

fn patterns(rng: &mut StdRng) -> Vec<Image> {
    PATTERNS.iter().map(|p| image(BLACK + p * (WHITE - BLACK), rng)).collect()
}

/// Weighted means of what noise has made of one intensity: their own standard deviation is 1e-4.
#[test]
fn noise_does_not_move_the_mean_of_a_scene() {
    let mut rng = StdRng::seed_from_u64(1);
    let capture = Capture {
        white: image(WHITE, &mut rng),
        black: Some(image(BLACK, &mut rng)),
        patterns: patterns(&mut rng),
        mono: vec![false; 3],
    };
    let m = Measurements::new(&capture, [SIDE, SIDE], &NOISE, &[], 0.0);
    for (j, expected) in PATTERNS.into_iter().enumerate() {
        let (mut sum, mut weights, mut chi2) = (0.0, 0.0, 0.0);
        for (p, w) in m.p.iter().skip(j).step_by(3).zip(m.inv_var.iter().skip(j).step_by(3)) {
            (sum, weights) = (sum + f64::from(w * p), weights + f64::from(*w));
            chi2 += f64::from(w * (p - expected).powi(2)) / (SIDE * SIDE) as f64;
        }
        let mean = sum / weights;
        assert!((mean - f64::from(expected)).abs() < 4e-4, "{mean}, not {expected}");
        // Clipping takes noise from what is dark.
        let least = if j == 0 { 0.6 } else { 0.95 };
        assert!((least..1.05).contains(&chi2), "χ² of {expected}: {chi2}");
    }
}

#[test]
fn nor_that_of_a_board() {
    let mut rng = StdRng::seed_from_u64(2);
    let (white, black) = (image(WHITE, &mut rng), image(BLACK, &mut rng));
    let mut builder = PositionBuilder::new(&white, black, 3, 0.02, Some(NOISE));
    patterns(&mut rng).iter().for_each(|pattern| builder.add(pattern));
    let (position, mut w) = (builder.finish(), [0.0; 3]);
    let mut sums = [[0.0f64; 2]; 3];
    for i in 0..SIDE * SIDE {
        position.weights_in_means(i, &NOISE, &mut w);
        for (j, [sum, weights]) in sums.iter_mut().enumerate() {
            *sum += f64::from(w[j] * position.values[3 * i + j]);
            *weights += f64::from(w[j]);
        }
    }
    for ([sum, weights], expected) in sums.into_iter().zip(PATTERNS) {
        let mean = sum / weights;
        assert!((mean - f64::from(expected)).abs() < 4e-4, "{mean}, not {expected}");
    }
}

#[test]
fn edges_stay_where_they_are() {
    let clean = |x: usize| if x % 20 < 10 { 0.6 } else { 0.1 };
    let mut rng = StdRng::seed_from_u64(3);
    let data = (0..SIDE * SIDE).map(|i| measured(clean(i % SIDE), &mut rng)).collect();
    let found = Intensities::new(&Image { width: SIDE, height: SIDE, channels: 1, data }, &NOISE);
    for (i, mean) in found.mean.iter().enumerate() {
        let sigma = NOISE.variance(clean(i % SIDE)).sqrt();
        assert!((mean - clean(i % SIDE)).abs() < 6.0 * sigma, "{i}: {mean}");
    }
    let scatter = found.mean.iter().enumerate().filter(|(i, _)| i % SIDE % 10 == 5);
    let far = scatter.filter(|(i, mean)| (*mean - clean(i % SIDE)).abs() > NOISE.variance(clean(i % SIDE)).sqrt());
    assert!(far.count() < SIDE * SIDE / 10 / 100, "a mean of 8 pixels scatters by a third");
}

/// The mean of max(d, N(μ, σ²)), by sums.
#[test]
fn what_clipping_adds_is_taken_off() {
    let noise = NoiseModel { read: 4e-6, gain: 0.0, darkest: Some(-1e-3) };
    for z in [-0.5f64, 0.0, 0.5, 1.0, 2.0, 3.5, 8.0] {
        let (mut sum, mut weights) = (0.0, 0.0);
        for i in -6000..=6000 {
            let x = f64::from(i) * 1e-3;
            let density = (-0.5 * x * x).exp();
            (sum, weights) = (sum + density * (x + z).max(0.0), weights + density);
        }
        let clipped = -1e-3 + 2e-3 * (sum / weights) as f32;
        // Means scatter: below zero, but not far.
        let expected = -1e-3 + 2e-3 * (z as f32).max(-0.3);
        assert!((noise.unclipped(clipped) - expected).abs() < 2e-6, "{z}: {}", noise.unclipped(clipped));
    }
    assert_eq!(NoiseModel { darkest: None, ..noise }.unclipped(-9e-4), -9e-4);
}

/// Means of eight pixels scatter; without light and near it, intensities are right in the mean nevertheless.
#[test]
fn the_dark_is_right_in_the_mean() {
    let mut rng = StdRng::seed_from_u64(4);
    let noise = NoiseModel { read: 1e-6, gain: 0.0, darkest: Some(0.0) };
    for light in [0.0f32, 3e-4, 7e-4, 1.5e-3, 4e-3] {
        let data = (0..SIDE * SIDE).map(|_| {
            let n = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
            (light + 1e-3 * n).max(0.0)
        });
        let image = Image { width: SIDE, height: SIDE, channels: 1, data: data.collect() };
        let found = Intensities::new(&image, &noise);
        let mean = found.own.iter().map(|v| f64::from(*v)).sum::<f64>() / (SIDE * SIDE) as f64;
        assert!((mean - f64::from(light)).abs() < 5e-5, "{light}: {mean}");
    }
}

#[test]
fn what_is_wanted_alone_is_the_same() {
    let mut rng = StdRng::seed_from_u64(5);
    let data: Vec<f32> = (0..SIDE * SIDE).map(|_| (3e-3 * (rng.random::<f32>() - 0.3)).max(0.0)).collect();
    let wanted: Vec<f32> = (0..SIDE * SIDE).map(|i| (i / SIDE % 3).min(i % 7) as f32).collect();
    let image = Image { width: SIDE, height: SIDE, channels: 1, data };
    let noise = NoiseModel { read: 1e-6, gain: 0.0, darkest: Some(0.0) };
    let (all, some) = (Intensities::new(&image, &noise).own, Intensities::own_where(&image, &noise, &wanted));
    for (i, wanted) in wanted.iter().enumerate() {
        assert_eq!(some[i], if *wanted > 0.0 { all[i] } else { image.data[i] }, "{i}");
    }
    assert!(all.iter().zip(&image.data).filter(|(a, b)| a != b).count() > SIDE * SIDE / 2);
    let unclipped = NoiseModel { darkest: None, ..noise };
    assert_eq!(*Intensities::own_where(&image, &unclipped, &wanted), Intensities::new(&image, &unclipped).own);
}
