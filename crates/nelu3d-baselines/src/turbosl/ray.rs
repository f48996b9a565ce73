//! TurboSL's image formation along one ray, and its gradient.
//!
//! Alphas are taken at the middle of every interval δ, from the signed distance f and the cosine c = d·n of ray and
//! normal (NeuS, Eq. 13, as its code has it), with r growing from 0 to 1:
//!
//! ```text
//! h = δ/2 [ (1 − r) relu(½ − ½ c) + r relu(−c) ]
//! alpha = (Φ(f + h) − Φ(f − h) + ε) / (Φ(f + h) + ε),   ε = 1e-5,   w_j = alpha_j Π_{l<j} (1 − alpha_l)
//! ```
//!
//! With s = n·l (light direction l), albedo a and ambient b of a camera pixel, C the blurred pattern and I the
//! captures:
//!
//! ```text
//! camera ray:     Σ_j w_j (a s_j C_j + b)  should be  I
//! projector ray:  Σ_j w_j (I_j − b_j) / m_j  should be  C,  m = clamp(a s, 0.1, 1);  their difference is scaled by Σ_j w_j m_j
//! ```
//!
//! Written once, for any scalar: central differences check it in `f64`, training runs it in `f32`.

use nelu3d_field::Real;
use nelu3d_field::volrend::midpoint::{self, Midpoint, MidpointRay};

/// Bounds of the reflectance that captures are divided by.
const REFLECTANCE: [f64; 2] = [0.1, 1.0];
/// The opacity's clamp in the mask loss.
const MASK_CLAMP: f64 = 1e-3;

/// The samples of a ray, of either kind.
#[derive(Debug)]
pub struct Along<'a, T> {
    /// The ray's samples, as midpoints of intervals.
    pub ray: MidpointRay<'a, T>,
    /// Unit directions to the light, per sample.
    pub light: &'a [[T; 3]],
}

/// What is rendered: k values of c camera channels by turns.
#[derive(Debug)]
pub enum Kind<'a, T> {
    /// A camera pixel.
    Camera {
        /// Whether the pixel is lit: 1 or 0, what its opacity should be.
        mask: T,
        /// The blurred patterns at the samples, `[sample][k]`.
        colors: &'a [T],
        /// A value of the pixel, per camera channel.
        albedo: &'a [T],
        /// A value of the pixel, per camera channel.
        ambient: &'a [T],
        /// What was captured, k values.
        measured: &'a [T],
    },
    /// A projector pixel.
    Projector {
        /// What the camera captured of the samples, `[sample][k]`.
        captured: &'a [T],
        /// A value of the camera's pixels, `[sample][channel]`.
        albedo: &'a [T],
        /// A value of the camera's pixels, `[sample][channel]`.
        ambient: &'a [T],
        /// The blurred patterns, k values.
        pattern: &'a [T],
    },
}

/// Weights of the losses of one ray.
#[derive(Clone, Copy, Debug)]
pub struct Weights<T> {
    /// Weight of a residual's absolute value.
    pub l1: T,
    /// Weight of its square.
    pub l2: T,
    /// Weight of one residual: 1 / (rays · k).
    pub image: T,
    /// Weight of a camera ray's mask loss.
    pub mask: T,
}

/// Gradients of one ray; all are overwritten.
#[derive(Debug)]
pub struct Gradient<'a, T> {
    /// By the signed distances of the samples.
    pub d_sdf: &'a mut [T],
    /// By the distances' gradients in space.
    pub d_gradients: &'a mut [[T; 3]],
    /// Albedo, then ambient (a camera ray's), then the pattern's k (a projector ray's).
    pub ray: &'a mut [T],
    /// Per sample: k colors (a camera ray's), or albedo, then ambient (a projector ray's).
    pub samples: &'a mut [T],
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Losses of one ray.
#[derive(Clone, Copy, Debug)]
pub struct RayLosses<T> {
    /// Image loss, weighted.
    pub image: T,
    /// Mask loss, not weighted.
    pub mask: T,
    /// Derivative of the weighted losses by the surface's sharpness.
    pub d_inv_s: T,
}

/// Returns the cosines between the samples' normals and the directions to the light.
fn shades<T: Real>(samples: &[Midpoint<T>], light: &[[T; 3]]) -> Vec<T> {
    samples.iter().zip(light).map(|(s, l)| dot(s.normal, *l)).collect()
}

/// Gradients of the losses by what compositing made of the samples.
struct SampleGradient<T> {
    weight: Vec<T>,
    shade: Vec<T>,
}

/// Computes the losses of one ray and their gradients.
pub fn ray<T: Real>(along: &Along<T>, kind: &Kind<T>, weights: Weights<T>, out: Gradient<T>) -> RayLosses<T> {
    let zero = T::of(0.0);
    let n = along.ray.sdf.len();
    out.ray.fill(zero);
    out.samples.fill(zero);
    let samples = composite(along);
    let shades = shades(&samples, along.light);
    let mut d = SampleGradient { weight: vec![zero; n], shade: vec![zero; n] };
    let image = match kind {
        Kind::Camera { .. } => camera_loss(kind, &samples, &shades, weights, out.ray, out.samples, &mut d),
        Kind::Projector { .. } => projector_loss(kind, &samples, &shades, weights, out.ray, out.samples, &mut d),
    };
    let mask = match kind {
        Kind::Camera { mask, .. } => mask_loss(&samples, *mask, weights.mask, &mut d.weight),
        Kind::Projector { .. } => zero,
    };
    let d_inv_s = backward(along, &samples, &d, out.d_sdf, out.d_gradients);
    RayLosses { image, mask, d_inv_s }
}

/// Composites the samples of a ray, from its start on.
fn composite<T: Real>(along: &Along<T>) -> Vec<Midpoint<T>> {
    let mut out = Vec::with_capacity(along.ray.sdf.len());
    midpoint::composite(&along.ray, &mut out);
    out
}

/// Returns the loss of a residual and its derivative.
fn robust<T: Real>(weights: &Weights<T>, r: T) -> (T, T) {
    (weights.l1 * r.abs() + weights.l2 * r * r, weights.l1 * sign(r) + T::of(2.0) * weights.l2 * r)
}

/// Returns the image loss of a camera ray and adds its gradients.
fn camera_loss<T: Real>(
    kind: &Kind<T>,
    samples: &[Midpoint<T>],
    shades: &[T],
    weights: Weights<T>,
    d_ray: &mut [T],
    d_samples: &mut [T],
    d_sample: &mut SampleGradient<T>,
) -> T {
    let Kind::Camera { colors, albedo, ambient, measured, .. } = *kind else { unreachable!("a camera ray") };
    let n_sample_outputs = d_samples.len() / samples.len().max(1);
    let opacity = samples.iter().map(|s| s.weight).sum::<T>();
    let (k, c) = (measured.len(), albedo.len());
    let mut loss = T::of(0.0);
    for i in 0..k {
        let (a, b) = (albedo[i % c], ambient[i % c]);
        let lit = samples.iter().enumerate().map(|(j, s)| s.weight * shades[j] * colors[j * k + i]).sum::<T>();
        let (value, slope) = robust(&weights, a * lit + b * opacity - measured[i]);
        loss += weights.image * value;
        let d = weights.image * slope;
        d_ray[i % c] += d * lit;
        d_ray[c + i % c] += d * opacity;
        for (j, s) in samples.iter().enumerate() {
            let color = colors[j * k + i];
            d_sample.weight[j] += d * (a * shades[j] * color + b);
            d_sample.shade[j] += d * s.weight * a * color;
            d_samples[j * n_sample_outputs + i] = d * s.weight * a * shades[j];
        }
    }
    loss
}

/// Returns the image loss of a projector ray and adds its gradients.
fn projector_loss<T: Real>(
    kind: &Kind<T>,
    samples: &[Midpoint<T>],
    shades: &[T],
    weights: Weights<T>,
    d_ray: &mut [T],
    d_samples: &mut [T],
    d_sample: &mut SampleGradient<T>,
) -> T {
    let Kind::Projector { captured, albedo, ambient, pattern } = *kind else { unreachable!("a projector ray") };
    let n_sample_outputs = d_samples.len() / samples.len().max(1);
    let k = pattern.len();
    let c = (albedo.len() / samples.len().max(1)).max(1);
    let [low, high] = REFLECTANCE.map(T::of);
    let m = |j: usize, ch: usize| (albedo[j * c + ch] * shades[j]).max(low).min(high);
    let mut loss = T::of(0.0);
    for i in 0..k {
        let ch = i % c;
        let (mut sum, mut reflectance) = (T::of(0.0), T::of(0.0));
        for (j, s) in samples.iter().enumerate() {
            sum += s.weight * (captured[j * k + i] - ambient[j * c + ch]) / m(j, ch);
            reflectance += s.weight * m(j, ch);
        }
        let (value, slope) = robust(&weights, (sum - pattern[i]) * reflectance);
        loss += weights.image * value;
        let d = weights.image * slope;
        let (d_sum, d_reflectance) = (d * reflectance, d * (sum - pattern[i]));
        d_ray[2 * c + i] = -d_sum;
        for (j, s) in samples.iter().enumerate() {
            let m = m(j, ch);
            let e = (captured[j * k + i] - ambient[j * c + ch]) / m;
            d_sample.weight[j] += d_sum * e + d_reflectance * m;
            d_samples[j * n_sample_outputs + c + ch] += -s.weight * d_sum / m;
            let a = albedo[j * c + ch];
            let product = a * shades[j];
            if product > low && product < high {
                let d_m = s.weight * (d_reflectance - d_sum * e / m);
                d_samples[j * n_sample_outputs + ch] += d_m * shades[j];
                d_sample.shade[j] += d_m * a;
            }
        }
    }
    loss
}

/// Returns the mask loss, not weighted, and adds its gradient: a lit pixel should be opaque, another transparent
/// (Eq. 5).
fn mask_loss<T: Real>(samples: &[Midpoint<T>], mask: T, weight: T, d_weight: &mut [T]) -> T {
    let one = T::of(1.0);
    let opacity = samples.iter().map(|s| s.weight).sum::<T>();
    let (low, high) = (T::of(MASK_CLAMP), T::of(1.0 - MASK_CLAMP));
    let o = opacity.max(low).min(high);
    if opacity > low && opacity < high {
        let slope = weight * (o - mask) / (o * (one - o));
        d_weight.iter_mut().for_each(|d| *d += slope);
    }
    -(mask * o.ln() + (one - mask) * (one - o).ln())
}

/// Goes back through compositing, alphas and normals; returns the derivative by the sharpness.
fn backward<T: Real>(
    along: &Along<T>,
    samples: &[Midpoint<T>],
    d: &SampleGradient<T>,
    d_sdf: &mut [T],
    d_gradients: &mut [[T; 3]],
) -> T {
    let normal = |(light, &shade): (&[T; 3], &T)| light.map(|l| shade * l);
    let d_normals: Vec<[T; 3]> = along.light.iter().zip(&d.shade).map(normal).collect();
    midpoint::composite_backward(&along.ray, samples, &d.weight, T::of(0.0), &d_normals, d_sdf, d_gradients)
}

fn sign<T: Real>(x: T) -> T {
    let zero = T::of(0.0);
    if x > zero {
        T::of(1.0)
    } else if x < zero {
        T::of(-1.0)
    } else {
        zero
    }
}
