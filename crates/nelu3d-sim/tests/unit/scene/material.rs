use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use nelu3d_sim::scene::GlossyCoating;

fn direction(cosine: f64, phi: f64) -> Vector3<f64> {
    let sine = (1.0 - cosine * cosine).sqrt();
    Vector3::new(sine * phi.cos(), sine * phi.sin(), cosine)
}

/// ∫ BRDF cos dω over the hemisphere by quadrature, not by the sampling that made the table.
fn furnace(gloss: &GlossyCoating, wo: &Vector3<f64>, albedo: f64) -> f64 {
    let n = 1500;
    let mut sum = 0.0;
    for i in 0..n {
        let cosine = (f64::from(i) + 0.5) / f64::from(n);
        for j in 0..n {
            let wi = direction(cosine, TAU * (f64::from(j) + 0.5) / f64::from(n));
            sum += (gloss.specular(wo, &wi) + albedo * gloss.diffuse(wo.z, wi.z)) * cosine;
        }
    }
    // dω = dμ dφ; the BRDF is 1/π of what is summed.
    sum * 2.0 / f64::from(n * n)
}

#[test]
fn no_energy_is_made_and_the_base_gets_what_is_left() {
    for roughness in [0.3, 0.5, 1.0] {
        for f0 in [0.04, 0.9] {
            let gloss = GlossyCoating::new(roughness, f0);
            for cosine in [0.1, 0.5, 0.95] {
                let wo = direction(cosine, 0.3);
                let (lacquer, both) = (furnace(&gloss, &wo, 0.0), furnace(&gloss, &wo, 1.0));
                let expected = gloss.specular_albedo(cosine);
                assert!((lacquer - expected).abs() < 0.01, "{roughness} {f0} {cosine}: {lacquer}, not {expected}");
                assert!(lacquer < 1.0 && both < 1.005 && both > 0.99, "{roughness} {f0} {cosine}: {both}");
            }
        }
    }
}

#[test]
fn both_directions_are_alike_and_the_peak_is_the_mirror() {
    let gloss = GlossyCoating::new(0.25, 0.04);
    let dirs: Vec<_> = (0..40).map(|i| direction(0.05 + 0.02 * f64::from(i), 1.7 * f64::from(i))).collect();
    for a in &dirs {
        for b in &dirs {
            let (there, back) = (gloss.specular(a, b), gloss.specular(b, a));
            assert!((there - back).abs() <= 1e-12 * there, "{there} {back}");
            assert!((gloss.diffuse(a.z, b.z) - gloss.diffuse(b.z, a.z)).abs() < 1e-15);
        }
    }
    let wo = direction(0.8, 0.0);
    let mirror = direction(0.8, PI);
    let peak = gloss.specular(&wo, &mirror);
    for i in 1..30 {
        for (cosine, phi) in [(0.8, PI + 0.1 * f64::from(i)), (0.8 + 0.15 * f64::from(i) / 30.0 + 0.04, PI)] {
            assert!(gloss.specular(&wo, &direction(cosine, phi)) < peak);
        }
    }
    // Head-on the peak has a closed form: π D F / 4, D = 1 / (π α²), and there no facet hides another.
    let z = Vector3::z();
    let expected = 0.04 / (4.0 * 0.25f64.powi(4));
    assert!((gloss.specular(&z, &z) / expected - 1.0).abs() < 1e-9);
}

#[test]
fn samples_follow_the_distribution() {
    // The mean of a function of the reflected light, by samples and by quadrature.
    let gloss = GlossyCoating::new(0.6, 0.2);
    let wo = direction(0.6, 0.0);
    let f = |w: &Vector3<f64>| (1.0 + w.x + 0.5 * w.y * w.z).powi(2);
    let n = 400;
    let (mut sampled, mut summed) = (0.0, 0.0);
    for i in 0..n {
        for j in 0..n {
            let u = [f64::from(i) + 0.5, f64::from(j) + 0.5].map(|v| v / f64::from(n));
            if let Some((wi, weight)) = gloss.sample_specular(&wo, u) {
                sampled += weight * f(&wi) / f64::from(n * n);
            }
            let wi = direction(u[0], TAU * u[1]);
            summed += 2.0 * gloss.specular(&wo, &wi) * wi.z * f(&wi) / f64::from(n * n);
        }
    }
    assert!((sampled / summed - 1.0).abs() < 0.002, "{sampled}, not {summed}");
}
