//! TurboSL's image formation along one ray, and its gradient.
//!
//! Alphas are taken at the middle of every interval δ, from the signed distance f and the cosine c = d·n of ray and normal
//! (NeuS, Eq. 13, as its code has it), with r growing from 0 to 1:
//!
//! ```text
//! h = δ/2 [ (1 − r) relu(½ − ½ c) + r relu(−c) ]
//! alpha = (Φ(f + h) − Φ(f − h) + ε) / (Φ(f + h) + ε),   ε = 1e-5,   w_j = alpha_j Π_{l<j} (1 − alpha_l)
//! ```
//!
//! With s = n·l (light direction l), albedo a and ambient b of a camera pixel, C the blurred pattern and I the captures:
//!
//! ```text
//! camera ray:     Σ_j w_j (a s_j C_j + b)  should be  I
//! projector ray:  Σ_j w_j (I_j − b_j) / m_j  should be  C,  m = clamp(a s, 0.1, 1);  their difference is scaled by Σ_j w_j m_j
//! ```
//!
//! Written once, for any scalar: central differences check it in `f64`, training runs it in `f32`.

use nelu3d_field::Real;

/// ε of the alphas.
const EPSILON: f64 = 1e-5;
/// Bounds of the reflectance that captures are divided by.
const REFLECTANCE: [f64; 2] = [0.1, 1.0];
/// The opacity's clamp in the mask loss.
const MASK_CLAMP: f64 = 1e-3;

/// What both kinds of ray know of their samples.
pub(crate) struct Along<'a, T> {
    /// Signed distances, units.
    pub(super) sdf: &'a [T],
    /// Their gradients.
    pub(super) gradients: &'a [[T; 3]],
    /// The ray's unit direction.
    pub(super) dir: [T; 3],
    /// Unit directions to the light.
    pub(super) light: &'a [[T; 3]],
    /// δ, units.
    pub(super) step: T,
    /// r
    pub(super) anneal: T,
    /// Sharpness.
    pub(super) inv_s: T,
}

/// What is rendered.
pub(crate) enum Kind<'a, T> {
    /// A camera pixel.
    Camera {
        /// The blurred patterns at the samples, `[sample][k]`.
        colors: &'a [T],
        /// Of the pixel, per camera channel.
        albedo: &'a [T],
        /// Of the pixel, per camera channel.
        ambient: &'a [T],
        /// What was captured, k values.
        measured: &'a [T],
    },
    /// A projector pixel.
    Projector {
        /// What the camera captured of the samples, `[sample][k]`.
        captured: &'a [T],
        /// Of the camera's pixels, `[sample][channel]`.
        albedo: &'a [T],
        /// Of the camera's pixels, `[sample][channel]`.
        ambient: &'a [T],
        /// The blurred patterns, k values.
        pattern: &'a [T],
    },
}

/// Weights of the losses of one ray.
#[derive(Clone, Copy)]
pub(crate) struct Weights<T> {
    pub(super) l1: T,
    pub(super) l2: T,
    /// Of one residual: 1 / (rays · k).
    pub(super) image: T,
    /// Of the ray's mask loss; 0 for none.
    pub(super) mask: T,
}

/// Gradients of one ray; all are overwritten.
pub(crate) struct Gradient<'a, T> {
    pub(super) d_sdf: &'a mut [T],
    pub(super) d_gradients: &'a mut [[T; 3]],
    /// Albedo, then ambient (a camera ray's), then the pattern's k (a projector ray's).
    pub(super) ray: &'a mut [T],
    /// Per sample: k colors (a camera ray's), or albedo, then ambient (a projector ray's).
    pub(super) samples: &'a mut [T],
}

/// What one sample passes on.
#[derive(Clone, Copy)]
struct Sample<T> {
    normal: [T; 3],
    /// 1 / |∇f|
    inv_norm: T,
    cos: T,
    h: T,
    /// Φ(f + h), Φ(f − h)
    phi: [T; 2],
    alpha: T,
    /// Before the sample.
    transmittance: T,
    weight: T,
    shade: T,
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn relu<T: Real>(x: T) -> T {
    x.max(T::of(0.0))
}

/// Image loss (weighted), mask loss (not weighted) and ∂/∂inv_s of one ray, with its gradients.
pub(crate) fn ray<T: Real>(along: &Along<T>, kind: &Kind<T>, weights: Weights<T>, out: Gradient<T>) -> (T, T, T) {
    let (zero, one, half, epsilon) = (T::of(0.0), T::of(1.0), T::of(0.5), T::of(EPSILON));
    let Along { sdf, gradients, dir, light, step, anneal, inv_s } = *along;
    let n = sdf.len();
    out.ray.fill(zero);
    out.samples.fill(zero);
    let n_sample_outputs = out.samples.len() / n.max(1);

    // Weights.
    let mut samples: Vec<Sample<T>> = Vec::with_capacity(n);
    let mut transmittance = one;
    for j in 0..n {
        let g = gradients[j];
        let inv_norm = one / dot(g, g).sqrt().max(T::of(1e-12));
        let normal = g.map(|x| x * inv_norm);
        let cos = dot(dir, normal);
        let h = half * step * ((one - anneal) * relu(half - half * cos) + anneal * relu(-cos));
        let phi = [(inv_s * (sdf[j] + h)).sigmoid(), (inv_s * (sdf[j] - h)).sigmoid()];
        let alpha = ((phi[0] - phi[1] + epsilon) / (phi[0] + epsilon)).max(zero).min(one);
        let weight = transmittance * alpha;
        let shade = dot(normal, light[j]);
        samples.push(Sample { normal, inv_norm, cos, h, phi, alpha, transmittance, weight, shade });
        transmittance *= one - alpha;
    }

    // The image, what it should be, and what the samples hear of it: ∂L/∂w and ∂L/∂s.
    let robust = |r: T| (weights.l1 * r.abs() + weights.l2 * r * r, weights.l1 * sign(r) + T::of(2.0) * weights.l2 * r);
    let opacity = samples.iter().map(|s| s.weight).sum::<T>();
    let mut loss = zero;
    let mut d_weight = vec![zero; n];
    let mut d_shade = vec![zero; n];
    match *kind {
        Kind::Camera { colors, albedo, ambient, measured } => {
            let (k, c) = (measured.len(), albedo.len());
            for i in 0..k {
                let (a, b) = (albedo[i % c], ambient[i % c]);
                let lit = samples.iter().enumerate().map(|(j, s)| s.weight * s.shade * colors[j * k + i]).sum::<T>();
                let (value, slope) = robust(a * lit + b * opacity - measured[i]);
                loss += weights.image * value;
                let d = weights.image * slope;
                out.ray[i % c] += d * lit;
                out.ray[c + i % c] += d * opacity;
                for (j, s) in samples.iter().enumerate() {
                    let color = colors[j * k + i];
                    d_weight[j] += d * (a * s.shade * color + b);
                    d_shade[j] += d * s.weight * a * color;
                    out.samples[j * n_sample_outputs + i] = d * s.weight * a * s.shade;
                }
            }
        }
        Kind::Projector { captured, albedo, ambient, pattern } => {
            let k = pattern.len();
            let c = (albedo.len() / n.max(1)).max(1);
            let [low, high] = REFLECTANCE.map(T::of);
            let m = |j: usize, ch: usize| (albedo[j * c + ch] * samples[j].shade).max(low).min(high);
            for i in 0..k {
                let ch = i % c;
                let (mut sum, mut reflectance) = (zero, zero);
                for (j, s) in samples.iter().enumerate() {
                    sum += s.weight * (captured[j * k + i] - ambient[j * c + ch]) / m(j, ch);
                    reflectance += s.weight * m(j, ch);
                }
                let (value, slope) = robust((sum - pattern[i]) * reflectance);
                loss += weights.image * value;
                let d = weights.image * slope;
                let (d_sum, d_reflectance) = (d * reflectance, d * (sum - pattern[i]));
                out.ray[2 * c + i] = -d_sum;
                for (j, s) in samples.iter().enumerate() {
                    let m = m(j, ch);
                    let e = (captured[j * k + i] - ambient[j * c + ch]) / m;
                    d_weight[j] += d_sum * e + d_reflectance * m;
                    out.samples[j * n_sample_outputs + c + ch] += -s.weight * d_sum / m;
                    let a = albedo[j * c + ch];
                    let product = a * s.shade;
                    if product > low && product < high {
                        let d_m = s.weight * (d_reflectance - d_sum * e / m);
                        out.samples[j * n_sample_outputs + ch] += d_m * s.shade;
                        d_shade[j] += d_m * a;
                    }
                }
            }
        }
    }

    // A lit pixel should be opaque (Eq. 5 with M = 1).
    let mut mask_loss = zero;
    if weights.mask > zero {
        let (low, high) = (T::of(MASK_CLAMP), T::of(1.0 - MASK_CLAMP));
        mask_loss = -opacity.max(low).min(high).ln();
        if opacity > low && opacity < high {
            d_weight.iter_mut().for_each(|d| *d += -weights.mask / opacity);
        }
    }

    // Back through compositing, alphas and normals.
    let mut after = zero;
    let mut d_inv_s = zero;
    for j in (0..n).rev() {
        let s = samples[j];
        let mut d_normal: [T; 3] = std::array::from_fn(|a| d_shade[j] * light[j][a]);
        let mut d_f = zero;
        let d_alpha = s.transmittance * d_weight[j] - after / (one - s.alpha).max(T::of(1e-10));
        after += s.weight * d_weight[j];
        if s.alpha > zero && s.alpha < one {
            let bottom = s.phi[0] + epsilon;
            let d_phi = [d_alpha * s.phi[1] / (bottom * bottom), -d_alpha / bottom];
            let slope = [s.phi[0] * (one - s.phi[0]) * d_phi[0], s.phi[1] * (one - s.phi[1]) * d_phi[1]];
            d_f = inv_s * (slope[0] + slope[1]);
            d_inv_s += slope[0] * (sdf[j] + s.h) + slope[1] * (sdf[j] - s.h);
            let d_h = inv_s * (slope[0] - slope[1]);
            let mut h_slope = zero;
            if s.cos < one {
                h_slope += -half * (one - anneal);
            }
            if s.cos < zero {
                h_slope += -anneal;
            }
            let d_cos = d_h * half * step * h_slope;
            for a in 0..3 {
                d_normal[a] += d_cos * dir[a];
            }
        }
        out.d_sdf[j] = d_f;
        let radial = dot(s.normal, d_normal);
        out.d_gradients[j] = std::array::from_fn(|a| (d_normal[a] - radial * s.normal[a]) * s.inv_norm);
    }
    (loss, mask_loss, d_inv_s)
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};

    /// Everything a ray depends on, flat: sdf, gradients, inv_s, then its kind's values.
    struct Scene {
        n: usize,
        k: usize,
        c: usize,
        is_camera: bool,
        light: Vec<[f64; 3]>,
        measured: Vec<f64>,
    }

    impl Scene {
        fn len(&self) -> usize {
            let own = if self.is_camera { self.n * self.k + 2 * self.c } else { 2 * self.n * self.c + self.k };
            4 * self.n + 1 + own
        }

        /// Loss, and its gradient by all of `x`.
        fn eval(&self, x: &[f64]) -> (f64, Vec<f64>) {
            let Scene { n, k, c, .. } = *self;
            let gradients: Vec<[f64; 3]> = x[n..4 * n].as_chunks::<3>().0.to_vec();
            let along = Along {
                sdf: &x[..n],
                gradients: &gradients,
                dir: [0.1, -0.2, (1.0f64 - 0.05).sqrt()],
                light: &self.light,
                step: 0.11,
                anneal: 0.3,
                inv_s: x[4 * n],
            };
            let own = &x[4 * n + 1..];
            let kind = if self.is_camera {
                let (colors, rest) = own.split_at(n * k);
                Kind::Camera { colors, albedo: &rest[..c], ambient: &rest[c..], measured: &self.measured }
            } else {
                let (fields, pattern) = own.split_at(2 * n * c);
                Kind::Projector {
                    captured: &self.measured,
                    albedo: &fields[..n * c],
                    ambient: &fields[n * c..],
                    pattern,
                }
            };
            let weights = Weights { l1: 1.0, l2: 10.0, image: 0.2, mask: if self.is_camera { 0.1 } else { 0.0 } };
            let n_sample = k.max(2 * c);
            let (mut d_sdf, mut d_gradients) = (vec![9.0; n], vec![[9.0; 3]; n]);
            let (mut per_ray, mut per_sample) = (vec![9.0; 2 * c + k], vec![9.0; n * n_sample]);
            let out = Gradient {
                d_sdf: &mut d_sdf,
                d_gradients: &mut d_gradients,
                ray: &mut per_ray,
                samples: &mut per_sample,
            };
            let (image, mask, d_inv_s) = ray(&along, &kind, weights, out);
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
        for (seed, is_camera, k, c) in [(1, true, 3, 1), (2, false, 3, 1), (3, true, 6, 3), (4, false, 6, 3)] {
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
            let scene = Scene { n, k, c, is_camera, light, measured };
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
        let along = Along {
            sdf: &sdf,
            gradients: &facing,
            dir: [0.0, 0.0, 1.0],
            light: &facing,
            step: 0.1,
            anneal: 1.0,
            inv_s: 1e4,
        };
        let colors: Vec<f64> = (0..n).map(|j| 0.1 * j as f64).collect();
        let measured = [0.5 * 0.5 * (colors[2] + colors[3]) + 0.1];
        let kind = Kind::Camera { colors: &colors, albedo: &[0.5], ambient: &[0.1], measured: &measured };
        let weights = Weights { l1: 1.0, l2: 10.0, image: 1.0, mask: 1.0 };
        let out = Gradient {
            d_sdf: &mut vec![0.0; n],
            d_gradients: &mut vec![[0.0; 3]; n],
            ray: &mut [0.0; 3],
            samples: &mut vec![0.0; 2 * n],
        };
        let (image, mask, _) = ray(&along, &kind, weights, out);
        // The interval between them is shared by both.
        assert!(image < 0.03 && mask < 2e-3, "{image} {mask}");
    }
}
