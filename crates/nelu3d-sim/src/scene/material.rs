//! How surfaces reflect: `π · BRDF`, so that a reflectance times an irradiance is what a pixel sees.
//!
//! Glossy: GGX microfacets (Walter et al., EGSR 2007) with Smith's height-correlated masking (Heitz, JCGT 2014) and
//! Schlick's Fresnel term, over a diffuse base that receives and emits what the microfacets do not reflect (Kelemen and
//! Szirmay-Kalos, Eurographics 2001 short papers). Both parts are reciprocal, and together they reflect at most all
//! light.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::Vector3;

use crate::spec::MaterialSpec;

/// The reflection of a surface by direction; see [`MaterialSpec`].
#[derive(Clone, Debug)]
pub(crate) enum Material {
    Lambert,
    Glossy(Arc<GlossyCoating>),
    Translucent { mean_free_path: f64, share: f64 },
}

impl Material {
    /// Returns the material of a checked spec.
    pub(crate) fn new(spec: &MaterialSpec) -> Self {
        match *spec {
            MaterialSpec::Lambert {} => Self::Lambert,
            MaterialSpec::Glossy { roughness, reflectance } => {
                Self::Glossy(Arc::new(GlossyCoating::new(roughness, reflectance)))
            }
            MaterialSpec::Translucent { mean_free_path_mm, share } => {
                Self::Translucent { mean_free_path: mean_free_path_mm, share }
            }
        }
    }
}

/// Entries of the table of directional albedos.
const N_COSINES: usize = 64;
/// Directions per entry, squared.
const N_DIRECTIONS: usize = 32;
/// Cosines below it count as this: grazing directions have no well-defined microfacets.
const MIN_COSINE: f64 = 1e-3;

/// A microfacet coating over a diffuse base.
#[derive(Debug)]
pub(crate) struct GlossyCoating {
    /// GGX's α.
    alpha: f64,
    /// Reflectance head-on.
    f0: f64,
    /// Directional albedo of the microfacets, by the cosine of the direction: i / (N_COSINES − 1).
    specular_albedo: [f64; N_COSINES],
    /// Mean of the directional albedo over a hemisphere of even light.
    mean_specular_albedo: f64,
}

impl GlossyCoating {
    /// Returns the coating of a roughness (the microfacets' α is its square) and a reflectance head-on.
    pub(crate) fn new(roughness: f64, reflectance: f64) -> Self {
        let mut gloss = Self {
            alpha: roughness * roughness,
            f0: reflectance,
            specular_albedo: [0.0; N_COSINES],
            mean_specular_albedo: 0.0,
        };
        gloss.specular_albedo = std::array::from_fn(|i| {
            let cosine = (i as f64 / (N_COSINES - 1) as f64).max(MIN_COSINE);
            let wo = Vector3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
            let n = N_DIRECTIONS;
            let weights = (0..n * n).map(|k| {
                let u = [(k % n) as f64 + 0.5, (k / n) as f64 + 0.5].map(|v| v / n as f64);
                gloss.sample_specular(&wo, u).map_or(0.0, |(_, weight)| weight)
            });
            weights.sum::<f64>() / (n * n) as f64
        });
        // ∫ 2 μ E(μ) dμ by Simpson's rule on every interval of the linear table.
        let step = 1.0 / (N_COSINES - 1) as f64;
        gloss.mean_specular_albedo = (1..N_COSINES)
            .map(|i| {
                let (a, b) = (gloss.specular_albedo[i - 1], gloss.specular_albedo[i]);
                let (x, y) = ((i - 1) as f64 * step, i as f64 * step);
                step / 3.0 * (a * x + (a + b) * (x + y) + b * y)
            })
            .sum();
        gloss
    }

    /// Returns the part of the light from a direction that the microfacets reflect, by the cosine to the normal.
    pub(crate) fn specular_albedo(&self, cosine: f64) -> f64 {
        let at = cosine.clamp(0.0, 1.0) * (N_COSINES - 1) as f64;
        let i = (at as usize).min(N_COSINES - 2);
        self.specular_albedo[i] + (at - i as f64) * (self.specular_albedo[i + 1] - self.specular_albedo[i])
    }

    /// Returns the diffuse base's reflectance between directions of the cosines `wo` and `wi`, as a part of what it
    /// would reflect without the coating.
    pub(crate) fn diffuse(&self, wo: f64, wi: f64) -> f64 {
        let passed = 1.0 - self.mean_specular_albedo;
        // Nothing passes a perfect mirror.
        if passed < 1e-9 { 0.0 } else { (1.0 - self.specular_albedo(wo)) * (1.0 - self.specular_albedo(wi)) / passed }
    }

    /// Returns `π · BRDF` of the microfacets between two unit vectors, the normal being z.
    pub(crate) fn specular(&self, wo: &Vector3<f64>, wi: &Vector3<f64>) -> f64 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let (o, i) = (wo.z.max(MIN_COSINE), wi.z.max(MIN_COSINE));
        let half = (wo + wi).normalize();
        let a2 = self.alpha * self.alpha;
        // 1 + (α² − 1) cos²: written with the sine, it does not cancel where the peak of a smooth surface is.
        let spread = (half.x * half.x + half.y * half.y) + a2 * half.z * half.z;
        let distribution = a2 / (PI * spread * spread);
        let masking = 1.0 / (1.0 + self.lambda(o) + self.lambda(i));
        PI * distribution * masking * self.fresnel(half.dot(wo)) / (4.0 * o * i)
    }

    /// Samples a direction in which the microfacets reflect light from `wo` by the distribution of visible normals
    /// (Heitz, JCGT 2018). Returns it with the part of the light it stands for, or `None` below the surface.
    pub(crate) fn sample_specular(&self, wo: &Vector3<f64>, [u0, u1]: [f64; 2]) -> Option<(Vector3<f64>, f64)> {
        let wo = Vector3::new(wo.x, wo.y, wo.z.max(MIN_COSINE)).normalize();
        let v = Vector3::new(self.alpha * wo.x, self.alpha * wo.y, wo.z).normalize();
        let across = v.x * v.x + v.y * v.y;
        let t1 = if across > 1e-24 { Vector3::new(-v.y, v.x, 0.0) / across.sqrt() } else { Vector3::x() };
        let t2 = v.cross(&t1);
        let (r, phi) = (u0.sqrt(), TAU * u1);
        let (p1, p2) = (r * phi.cos(), r * phi.sin());
        let s = 0.5 * (1.0 + v.z);
        let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * p2;
        let n = t1 * p1 + t2 * p2 + v * (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
        let half = Vector3::new(self.alpha * n.x, self.alpha * n.y, n.z.max(0.0)).normalize();
        let wi = half * (2.0 * half.dot(&wo)) - wo;
        if wi.z <= 0.0 {
            return None;
        }
        let (lo, li) = (self.lambda(wo.z), self.lambda(wi.z.max(MIN_COSINE)));
        Some((wi, self.fresnel(half.dot(&wo)) * (1.0 + lo) / (1.0 + lo + li)))
    }

    /// Returns Schlick's approximation of the Fresnel reflectance.
    fn fresnel(&self, cosine: f64) -> f64 {
        self.f0 + (1.0 - self.f0) * (1.0 - cosine).clamp(0.0, 1.0).powi(5)
    }

    /// Returns Smith's Λ for a direction's cosine.
    fn lambda(&self, cosine: f64) -> f64 {
        let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
        0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
