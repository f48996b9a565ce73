use crate::check::{assert_gradient, uniform};
use nelu3d_field::volrend::midpoint::{EPSILON, MidpointRay, composite, composite_backward};
use nelu3d_field::volrend::reference;

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A ray through two walls, with gradients of any length and direction, and intervals of any length.
struct Samples {
    sdf: Vec<f64>,
    gradients: Vec<f64>,
    lengths: Vec<f64>,
    d_weights: Vec<f64>,
    d_normals: Vec<[f64; 3]>,
}

impl Samples {
    fn new(seed: u64, n: usize) -> Self {
        let noise = uniform(seed, n, -0.1, 0.1);
        Self {
            sdf: (0..n).map(|j| (j as f64 / n as f64 * 9.0 + seed as f64).cos() * 0.8 + noise[j]).collect(),
            gradients: uniform(seed + 1, 3 * n, -1.0, 1.0),
            lengths: uniform(seed + 2, n, 0.05, 0.4),
            d_weights: uniform(seed + 3, n, -1.0, 1.0),
            d_normals: uniform(seed + 4, 3 * n, -1.0, 1.0).as_chunks().0.to_vec(),
        }
    }

    fn ray<'a>(&'a self, sdf: &'a [f64], gradients: &'a [f64], anneal: f64, inv_s: f64) -> MidpointRay<'a, f64> {
        let gradients = gradients.as_chunks().0;
        MidpointRay { sdf, gradients, lengths: &self.lengths, dir: [0.48, -0.6, 0.64], anneal, inv_s }
    }
}

#[test]
fn gradients_match_central_differences() {
    for (seed, anneal) in [(0, 0.0), (1, 0.3), (2, 1.0)] {
        let (s, inv_s) = (Samples::new(seed, 20), 5.0);
        let loss = |sdf: &[f64], gradients: &[f64], inv_s: f64| {
            let mut out = Vec::new();
            let transmittance = composite(&s.ray(sdf, gradients, anneal, inv_s), &mut out);
            let by_weight: f64 = out.iter().zip(&s.d_weights).map(|(o, d)| o.weight * d).sum();
            let by_normal: f64 = out.iter().zip(&s.d_normals).map(|(o, d)| dot(o.normal, *d)).sum();
            by_weight + by_normal + 0.7 * transmittance.ln()
        };
        let ray = s.ray(&s.sdf, &s.gradients, anneal, inv_s);
        let mut out = Vec::new();
        composite(&ray, &mut out);
        let (mut d_sdf, mut d_g) = (vec![0.0; 20], vec![[0.0; 3]; 20]);
        let d_inv_s = composite_backward(&ray, &out, &s.d_weights, 0.7, &s.d_normals, &mut d_sdf, &mut d_g);
        assert_gradient(&s.sdf, &d_sdf, 1e-5, |f| loss(f, &s.gradients, inv_s));
        assert_gradient(&s.gradients, d_g.as_flattened(), 1e-5, |g| loss(&s.sdf, g, inv_s));
        assert_gradient(&[inv_s], &[d_inv_s], 1e-4, |v| loss(&s.sdf, &s.gradients, v[0]));
    }
}

/// On a plane that faces the ray, intervals that touch see the distances at their ends: the sections of NeuS.
#[test]
fn a_facing_plane_is_seen_as_by_sections() {
    let (n, inv_s) = (40, 20.0);
    let (length, depth) = (1.0 / n as f64, 0.53);
    let sdf: Vec<f64> = (0..n).map(|j| depth - (j as f64 + 0.5) * length).collect();
    let ends: Vec<f64> = (0..=n).map(|j| depth - j as f64 * length).collect();
    let (gradients, lengths) = (vec![[0.0, 0.0, -1.0]; n], vec![length; n]);
    let dir = [0.0, 0.0, 1.0];
    let ray = MidpointRay { sdf: &sdf, gradients: &gradients, lengths: &lengths, dir, anneal: 1.0, inv_s };
    let mut out = Vec::new();
    let left = composite(&ray, &mut out);
    let mut weights = vec![0.0; n + 1];
    reference::render_weights(&ends, inv_s, &mut weights);
    for (o, w) in out.iter().zip(&weights) {
        assert!((o.weight - w).abs() < 20.0 * EPSILON, "{} {w}", o.weight);
    }
    assert!((left + weights.iter().sum::<f64>() - 1.0).abs() < n as f64 * EPSILON);
}

#[test]
fn extremes_stay_finite() {
    let sdf = [1e4f32, 3.0, -3.0, -1e4, 0.0];
    let gradients = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [1e6, 0.0, 0.0], [0.0, 0.0, 1e-30]];
    let ray = MidpointRay {
        sdf: &sdf,
        gradients: &gradients,
        lengths: &[0.1; 5],
        dir: [0.0, 0.0, 1.0],
        anneal: 0.5,
        inv_s: 1e4,
    };
    let (mut out, mut d_sdf, mut d_g) = (Vec::new(), [0.0; 5], [[0.0; 3]; 5]);
    let left = composite(&ray, &mut out);
    let d = composite_backward(&ray, &out, &[1.0, -2.0, 3.0, 4.0, 5.0], 0.1, &[], &mut d_sdf, &mut d_g);
    assert!(left.is_finite() && d.is_finite() && d_sdf.iter().all(|x| x.is_finite()), "{left} {d} {d_sdf:?}");
    assert!(d_g.iter().flatten().all(|x| x.is_finite()), "{d_g:?}");
}
