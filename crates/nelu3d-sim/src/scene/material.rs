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
pub struct GlossyCoating {
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
    pub fn new(roughness: f64, reflectance: f64) -> Self {
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
    pub fn specular_albedo(&self, cosine: f64) -> f64 {
        let at = cosine.clamp(0.0, 1.0) * (N_COSINES - 1) as f64;
        let i = (at as usize).min(N_COSINES - 2);
        self.specular_albedo[i] + (at - i as f64) * (self.specular_albedo[i + 1] - self.specular_albedo[i])
    }

    /// Returns the diffuse base's reflectance between directions of the cosines `wo` and `wi`, as a part of what it
    /// would reflect without the coating.
    pub fn diffuse(&self, wo: f64, wi: f64) -> f64 {
        let passed = 1.0 - self.mean_specular_albedo;
        // Nothing passes a perfect mirror.
        if passed < 1e-9 { 0.0 } else { (1.0 - self.specular_albedo(wo)) * (1.0 - self.specular_albedo(wi)) / passed }
    }

    /// Returns `π · BRDF` of the microfacets between two unit vectors away from the surface, the normal being z.
    pub fn specular(&self, wo: &Vector3<f64>, wi: &Vector3<f64>) -> f64 {
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
    /// (Heitz, JCGT 2018). Returns it with the part of the light it stands for, or `None` below the surface. The last
    /// argument are two random numbers in `[0, 1)`.
    pub fn sample_specular(&self, wo: &Vector3<f64>, [u0, u1]: [f64; 2]) -> Option<(Vector3<f64>, f64)> {
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
