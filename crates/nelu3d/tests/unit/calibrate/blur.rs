use std::f64::consts::TAU;

use nelu3d::calibrate::Position;
use nelu3d::calibrate::blur::BlurEstimator;
use nelu3d::sensor::Blur;
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

const SIZE: usize = 120;

/// A chessboard of squares of 17 pixels under a code of two channels, seen through a Gaussian blur of a variance.
fn seen_through<const K: usize>(variance: f64, code: impl Fn(f64, f64) -> [f64; K]) -> Position {
    let albedo = |x: f64, y: f64| if ((x / 17.0).floor() + (y / 17.0).floor()) as i64 % 2 == 0 { 0.8 } else { 0.06 };
    // A fourth of a pixel apart.
    let reach = (16.0 * variance.sqrt()).ceil() as i32;
    let weights: Vec<f64> = (-reach..=reach).map(|i| (-f64::from(i * i) / (32.0 * variance)).exp()).collect();
    let all: f64 = weights.iter().sum::<f64>().powi(2);
    let (mut values, mut contrast) = (Vec::new(), Vec::new());
    for i in 0..SIZE * SIZE {
        let (mut light, mut lit) = (0.0, [0.0; K]);
        for (v, wv) in weights.iter().enumerate() {
            for (u, wu) in weights.iter().enumerate() {
                let [x, y] = [(i % SIZE, u), (i / SIZE, v)]
                    .map(|(at, j)| at as f64 + 0.5 + 0.25 * (j as f64 - f64::from(reach)));
                let (albedo, c) = (wu * wv * albedo(x, y), code(x, y));
                light += albedo;
                lit.iter_mut().zip(c).for_each(|(sum, c)| *sum += albedo * c);
            }
        }
        contrast.push((light / all) as f32);
        values.extend(lit.map(|v| (v / light) as f32));
    }
    let (around, edge) = (vec![0.8; SIZE * SIZE], vec![0.0; SIZE * SIZE]);
    Position { width: SIZE, height: SIZE, k: K, channels: 1, values, contrast, light: Vec::new(), around, edge }
}

fn phases(x: f64, y: f64) -> [f64; 2] {
    let wave = |period: f64| 0.5 + 0.45 * (TAU * (x + 0.3 * y) / period).cos();
    [wave(13.0), wave(41.0)]
}

fn stripes(x: f64, y: f64) -> [f64; 2] {
    let stripe = |width: f64| ((x + 0.3 * y) / width).floor().rem_euclid(2.0);
    [stripe(6.0), stripe(11.0)]
}

fn found(position: &Position) -> Blur {
    let mut estimator = BlurEstimator::default();
    estimator.add(position, |_| true);
    estimator.finish()
}

#[test]
fn edges_of_ink_tell_the_blur() {
    for variance in [0.3, 0.6] {
        let s2 = found(&seen_through(variance, phases)).variance();
        assert!((0.8 * variance..1.25 * variance).contains(&f64::from(s2)), "{s2} for {variance}");
    }
}

#[test]
fn stripes_that_end_at_ink_are_no_blur() {
    let s2 = found(&seen_through(0.3, stripes)).variance();
    assert!((0.1..0.6).contains(&s2), "{s2}");
}

#[test]
fn codewords_beside_ink_are_those_of_the_place_that_their_light_comes_from() {
    let position = seen_through(0.7, phases);
    let blur = found(&position);
    let rms = |blur: Blur| {
        let (mut sum, mut n) = (0.0f64, 0.0);
        for i in (0..SIZE * SIZE).filter(|i| position.contrast[*i] > 0.25) {
            let gradient = position.log_gradient(i);
            if gradient[0].hypot(gradient[1]) > 0.1 {
                let [dx, dy] = blur.shift(gradient).map(f64::from);
                let c = phases((i % SIZE) as f64 + 0.5 + dx, (i / SIZE) as f64 + 0.5 + dy);
                sum += c.iter().zip(&position.values[2 * i..]).map(|(c, v)| (c - f64::from(*v)).powi(2)).sum::<f64>();
                n += 2.0;
            }
        }
        (sum / n).sqrt()
    };
    let [before, after] = [rms(Blur::new(0.0)), rms(blur)];
    assert!(before > 0.03 && after < 0.6 * before, "{before} to {after}");
}

#[test]
fn ink_that_is_too_dark_to_be_used_has_edges_as_well() {
    let mut position = seen_through(0.6, phases);
    position.contrast.iter_mut().filter(|c| **c < 0.15).for_each(|c| *c = 0.0);
    let s2 = found(&position).variance();
    assert!((0.4..0.9).contains(&s2), "{s2}");
    // The other neighbor tells the gradient, and none does where both are missing.
    let i = (0..SIZE * SIZE).find(|i| position.contrast[*i] > 0.0 && position.contrast[*i + 1] == 0.0).unwrap();
    let [before, own] = [position.contrast[i - 1], position.contrast[i]];
    assert_eq!(position.log_gradient(i)[0], (own - before) / own);
    position.contrast[i - 1] = 0.0;
    assert_eq!(position.log_gradient(i)[0], 0.0);
}

#[test]
fn without_edges_the_blur_is_a_typical_one() {
    let mut position = seen_through(0.6, phases);
    position.contrast.fill(0.8);
    let typical = BlurEstimator::default().finish();
    assert_eq!(found(&position), typical);
    assert!((0.1..0.5).contains(&typical.variance()));
}

/// Value of a Gray code's stripes of a width whose edges are soft.
fn stripe(x: f64, width: f64) -> f64 {
    let from_edge = 0.5 - (0.5 * x / width).rem_euclid(1.0);
    0.5 + 0.5 * (width * (4.0 * from_edge.abs() - 1.0) / 0.4).tanh()
}

#[test]
fn stripes_finer_than_a_polynomial_count_little() {
    let code = |x: f64, y: f64| {
        std::array::from_fn::<f64, 12, _>(|n| {
            let width = 1.4 * f64::from(1 << (n % 6));
            stripe(if n < 6 { x + 0.3 * y } else { 0.9 * y - 0.3 * x } + 0.5 * width, width)
        })
    };
    let code = |noise| (noise, seen_through(0.2, code));
    for (noise, mut position) in [0.005, 0.02].map(code) {
        let mut random = StdRng::seed_from_u64(1);
        for (values, contrast) in position.values.chunks_mut(position.k).zip(&position.contrast) {
            let sigma = noise / contrast;
            values.iter_mut().for_each(|v| {
                let z: f32 = StandardNormal.sample(&mut random);
                *v += sigma * z;
            });
        }
        let s2 = found(&position).variance();
        assert!(s2 < 0.32, "{s2} at a noise of {noise}");
    }
}
