//! The gradients of a ray against central differences.

use nelu3d_baselines::turbosl::ray::{Along, Gradient, Kind, RayLosses, Weights, ray};
use nelu3d_field::volrend::midpoint::MidpointRay;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Everything a ray depends on, flat: sdf, gradients, inv_s, then its kind's values.
struct TestRay {
    n: usize,
    k: usize,
    c: usize,
    is_camera: bool,
    mask: f64,
    light: Vec<[f64; 3]>,
    measured: Vec<f64>,
}

impl TestRay {
    fn len(&self) -> usize {
        let own = if self.is_camera { self.n * self.k + 2 * self.c } else { 2 * self.n * self.c + self.k };
        4 * self.n + 1 + own
    }

    /// Loss, and its gradient by all of `x`.
    fn eval(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let TestRay { n, k, c, .. } = *self;
        let gradients: Vec<[f64; 3]> = x[n..4 * n].as_chunks::<3>().0.to_vec();
        let lengths = vec![0.11; n];
        let dir = [0.1, -0.2, (1.0f64 - 0.05).sqrt()];
        let (sdf, inv_s) = (&x[..n], x[4 * n]);
        let ray_along = MidpointRay { sdf, gradients: &gradients, lengths: &lengths, dir, anneal: 0.3, inv_s };
        let along = Along { ray: ray_along, light: &self.light };
        let own = &x[4 * n + 1..];
        let kind = if self.is_camera {
            let (colors, rest) = own.split_at(n * k);
            Kind::Camera { mask: self.mask, colors, albedo: &rest[..c], ambient: &rest[c..], measured: &self.measured }
        } else {
            let (fields, pattern) = own.split_at(2 * n * c);
            Kind::Projector { captured: &self.measured, albedo: &fields[..n * c], ambient: &fields[n * c..], pattern }
        };
        let weights = Weights { l1: 1.0, l2: 10.0, image: 0.2, mask: if self.is_camera { 0.1 } else { 0.0 } };
        let n_sample = k.max(2 * c);
        let (mut d_sdf, mut d_gradients) = (vec![9.0; n], vec![[9.0; 3]; n]);
        let (mut per_ray, mut per_sample) = (vec![9.0; 2 * c + k], vec![9.0; n * n_sample]);
        let out =
            Gradient { d_sdf: &mut d_sdf, d_gradients: &mut d_gradients, ray: &mut per_ray, samples: &mut per_sample };
        let RayLosses { image, mask, d_inv_s } = ray(&along, &kind, weights, out);
        let mut d = d_sdf;
        d.extend(d_gradients.iter().flatten());
        d.push(d_inv_s);
        let rows = per_sample.chunks_exact(n_sample);
        if self.is_camera {
            rows.for_each(|row| d.extend(&row[..k]));
            d.extend(&per_ray[..2 * c]);
        } else {
            rows.clone().for_each(|row| d.extend(&row[..c]));
            rows.for_each(|row| d.extend(&row[c..2 * c]));
            d.extend(&per_ray[2 * c..]);
        }
        (image + weights.mask * mask, d)
    }
}

#[test]
fn gradients_match_central_differences() {
    let cases = [(1, true, 3, 1), (2, false, 3, 1), (3, true, 6, 3), (4, false, 6, 3), (6, true, 3, 1)];
    for (seed, is_camera, k, c) in cases {
        let mut rng = StdRng::seed_from_u64(seed);
        let n = 9;
        let unit = |rng: &mut StdRng| {
            let v: [f64; 3] = [rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3), -0.9];
            let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            v.map(|x| x / norm)
        };
        let light = (0..n).map(|_| unit(&mut rng)).collect();
        let n_measured = if is_camera { k } else { n * k };
        let measured = (0..n_measured).map(|_| rng.random_range(0.1..0.9)).collect();
        // The last is a camera ray of the background.
        let mask = if seed == 6 { 0.0 } else { 1.0 };
        let scene = TestRay { n, k, c, is_camera, mask, light, measured };
        // A surface that is crossed in the middle, with normals that face the ray more or less.
        let mut x: Vec<f64> = (0..n).map(|j| 0.4 - 0.1 * j as f64 + rng.random_range(-0.03..0.03)).collect();
        for _ in 0..n {
            x.extend(unit(&mut rng).map(|v| 1.2 * v));
        }
        x.push(6.0);
        x.extend((x.len()..scene.len()).map(|_| rng.random_range(0.2..0.8)));
        let (_, d) = scene.eval(&x);
        let norm = d.iter().map(|d| d * d).sum::<f64>().sqrt();
        for i in 0..x.len() {
            let at = |e: f64| {
                let mut x = x.clone();
                x[i] += e;
                scene.eval(&x).0
            };
            let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((d[i] - expected).abs() < 1e-7 * norm.max(1.0), "{seed}: {i}: {} {expected}", d[i]);
        }
    }
}

#[test]
fn a_surface_in_the_right_place_has_no_residual() {
    // A sharp surface between the third and the fourth sample, seen head on.
    let n = 6;
    let sdf: Vec<f64> = (0..n).map(|j| 0.25 - 0.1 * j as f64).collect();
    let facing = vec![[0.0, 0.0, -1.0]; n];
    let (lengths, dir) = (vec![0.1; n], [0.0, 0.0, 1.0]);
    let samples = MidpointRay { sdf: &sdf, gradients: &facing, lengths: &lengths, dir, anneal: 1.0, inv_s: 1e4 };
    let along = Along { ray: samples, light: &facing };
    let colors: Vec<f64> = (0..n).map(|j| 0.1 * j as f64).collect();
    let measured = [0.5 * 0.5 * (colors[2] + colors[3]) + 0.1];
    let kind = Kind::Camera { mask: 1.0, colors: &colors, albedo: &[0.5], ambient: &[0.1], measured: &measured };
    let weights = Weights { l1: 1.0, l2: 10.0, image: 1.0, mask: 1.0 };
    let out = Gradient {
        d_sdf: &mut vec![0.0; n],
        d_gradients: &mut vec![[0.0; 3]; n],
        ray: &mut [0.0; 3],
        samples: &mut vec![0.0; 2 * n],
    };
    let RayLosses { image, mask, .. } = ray(&along, &kind, weights, out);
    // The interval between them is shared by both.
    assert!(image < 0.03 && mask < 2e-3, "{image} {mask}");
}
