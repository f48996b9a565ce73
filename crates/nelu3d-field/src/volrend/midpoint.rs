//! Alphas at the middle of intervals, as the public code of NeuS and TurboSL has them, along one ray.
//!
//! A sample with signed distance f, gradient ∇f, and the interval δ around it sees the surface as a plane, with the
//! cosine c = ⟨v, ∇f/‖∇f‖⟩ of ray and normal. While r grows from 0 to 1, half of the interval's change of distance goes
//! from one that is never zero to the true one:
//!
//! ```text
//! h = δ/2 [ (1 − r) relu(½ − ½ c) + r relu(−c) ]
//! alpha = (Φ(f + h) − Φ(f − h) + ε) / (Φ(f + h) + ε),   ε = 1e-5,   w_j = alpha_j Π_{l<j} (1 − alpha_l)
//! ```
//!
//! Written once, for any scalar: central differences check it in `f64`, training runs it in `f32`.

use crate::Real;

/// ε of the alphas.
pub const EPSILON: f64 = 1e-5;
/// The least 1 − alpha that is divided by.
pub(crate) const LEAST_PASSED: f64 = 1e-10;

/// The samples of a ray.
#[derive(Clone, Copy, Debug)]
pub struct MidpointRay<'a, T> {
    /// Signed distances, front to back.
    pub sdf: &'a [T],
    /// Their gradients in space.
    pub gradients: &'a [[T; 3]],
    /// Lengths δ of the samples' intervals, in the unit of the distance.
    pub lengths: &'a [T],
    /// The ray's unit direction.
    pub dir: [T; 3],
    /// r, from 0 to 1.
    pub anneal: T,
    /// Sharpness of Φ(f) = sigmoid(inv_s f).
    pub inv_s: T,
}

/// A composited sample.
#[derive(Clone, Copy, Debug)]
pub struct Midpoint<T> {
    /// Unit normal ∇f/‖∇f‖.
    pub normal: [T; 3],
    /// Weight w of the sample.
    pub weight: T,
    /// 1 / ‖∇f‖
    inv_norm: T,
    cos: T,
    h: T,
    /// Φ(f + h), Φ(f − h)
    phi: [T; 2],
    /// 1 − alpha
    passed: T,
    /// Transmittance before the sample.
    transmittance: T,
}

#[inline(always)]
fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Composites the samples of a ray into `out`; returns the transmittance behind the last.
#[inline(always)]
pub fn composite<T: Real>(ray: &MidpointRay<'_, T>, out: &mut Vec<Midpoint<T>>) -> T {
    let (zero, one, half, epsilon) = (T::of(0.0), T::of(1.0), T::of(0.5), T::of(EPSILON));
    let mut transmittance = one;
    out.clear();
    for ((&f, &g), &length) in ray.sdf.iter().zip(ray.gradients).zip(ray.lengths) {
        let inv_norm = one / dot(g, g).sqrt().max(T::of(1e-12));
        let normal = g.map(|x| x * inv_norm);
        let cos = dot(ray.dir, normal);
        let (soft, hard) = ((half - half * cos).max(zero), (-cos).max(zero));
        let h = half * length * ((one - ray.anneal) * soft + ray.anneal * hard);
        let phi = [(ray.inv_s * (f + h)).sigmoid(), (ray.inv_s * (f - h)).sigmoid()];
        let passed = (phi[1] / (phi[0] + epsilon)).min(one);
        let weight = transmittance * (one - passed);
        out.push(Midpoint { normal, weight, inv_norm, cos, h, phi, passed, transmittance });
        transmittance *= passed;
    }
    transmittance
}

/// Writes the gradients of one ray's distances and of their gradients, and returns that of `inv_s`, given those of the
/// weights, of the logarithm of the transmittance behind the last sample, and of the normals (empty: zero).
#[inline(always)]
pub fn composite_backward<T: Real>(
    ray: &MidpointRay<'_, T>,
    samples: &[Midpoint<T>],
    d_weights: &[T],
    d_log_transmittance: T,
    d_normals: &[[T; 3]],
    d_sdf: &mut [T],
    d_gradients: &mut [[T; 3]],
) -> T {
    let (zero, one, half, epsilon) = (T::of(0.0), T::of(1.0), T::of(0.5), T::of(EPSILON));
    let mut after = zero;
    let mut d_inv_s = zero;
    for j in (0..samples.len()).rev() {
        let s = samples[j];
        let mut d_normal = d_normals.get(j).copied().unwrap_or([zero; 3]);
        let mut d_f = zero;
        let d_alpha =
            s.transmittance * d_weights[j] - (after + d_log_transmittance) / s.passed.max(T::of(LEAST_PASSED));
        after += s.weight * d_weights[j];
        if s.passed > zero && s.passed < one {
            let bottom = s.phi[0] + epsilon;
            let d_phi = [d_alpha * s.phi[1] / (bottom * bottom), -d_alpha / bottom];
            let slope = [s.phi[0] * (one - s.phi[0]) * d_phi[0], s.phi[1] * (one - s.phi[1]) * d_phi[1]];
            d_f = ray.inv_s * (slope[0] + slope[1]);
            d_inv_s += slope[0] * (ray.sdf[j] + s.h) + slope[1] * (ray.sdf[j] - s.h);
            let d_h = ray.inv_s * (slope[0] - slope[1]);
            let soft = if s.cos < one { half * (one - ray.anneal) } else { zero };
            let hard = if s.cos < zero { ray.anneal } else { zero };
            let d_cos = -d_h * half * ray.lengths[j] * (soft + hard);
            for a in 0..3 {
                d_normal[a] += d_cos * ray.dir[a];
            }
        }
        d_sdf[j] = d_f;
        let radial = dot(s.normal, d_normal);
        for a in 0..3 {
            d_gradients[j][a] = (d_normal[a] - radial * s.normal[a]) * s.inv_norm;
        }
    }
    d_inv_s
}
