//! The offset from the light that throws the patterns to the light of the white image.
//!
//! A film projector throws its patterns with one lamp and lights the white image (flash) with another beside it. From a
//! point of a Lambertian surface with normal n, let L lead to the patterns' light, and L + o to the flash: it receives
//! n·L/|L|³ and n·(L + o)/|L + o|³. Normalized intensities are pattern over white, so to first order in o they are
//!
//! ```text
//! γ c,   γ = 1 − o · (n/(n·L) − m/(m·L))
//! ```
//!
//! where c is the color field, made from boards of normal m: what depends on the place alone is in it. A board faces
//! camera and light, a surface does not: of 4 mm at 650 mm, γ is 0.6 % at a slant of 45°, and depth changes a
//! codeword by as much in half a millimeter.
//!
//! The two components of o across the light's mean direction are found by least squares from what no depth of a pixel
//! explains, all pixels together, with a constant factor as a nuisance (boards that faced elsewhere). Its error is told
//! by how much squares of the image disagree; of what is not far beyond that error nothing is applied.

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};
use rayon::prelude::*;

use super::light_fractions::LightFractions;
use super::window::Window;
use crate::color_field::CameraRays;
use crate::sensor::Measurements;

/// Squares of the image across its width, which count as one sample each.
const SQUARES: usize = 16;
/// Fewest squares that tell an offset.
const MIN_SQUARES: usize = 12;
/// Squared offset over its variance up to which nothing is applied; all of it is from twice that on. Squares share
/// errors, too.
const BY_CHANCE: f64 = 16.0;
/// Prior standard deviation of the offset, as a part of the distance to the light, and of the constant factor.
const PRIOR: [f64; 2] = [0.05, 0.01];
/// Pixels that share errors and count as one where they meet the prior.
const PIXELS_PER_SAMPLE: f64 = 50.0;
/// Least cosine between light and normal: beyond it next to nothing of the light arrives.
const MIN_COSINE: f64 = 0.15;
/// Largest change of a codeword.
const MAX_CHANGE: f64 = 0.1;

/// The offset, and where the light is.
pub(super) struct FlashOffset<'a> {
    rays: &'a CameraRays,
    window: &'a Window,
    active: &'a [bool],
    /// The patterns' light, mm.
    light: Point3<f64>,
    /// Unit vectors across the light's mean direction.
    across: [Vector3<f64>; 2],
    /// Mean distance to the light, mm.
    distance: f64,
    /// What is applied, mm along [`Self::across`].
    pub(super) applied: Vector2<f64>,
}

/// Normal equations of the offset's two components and the constant factor, and the number of pixels in them.
#[derive(Clone, Copy)]
struct Equations {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    n: usize,
}

impl<'a> FlashOffset<'a> {
    /// An offset of zero from the light at `light` of a surface whose mean inverse depth is `inv_z`, 1/mm.
    pub(super) fn new(
        rays: &'a CameraRays,
        window: &'a Window,
        active: &'a [bool],
        light: Point3<f64>,
        inv_z: f64,
    ) -> Self {
        let on = (0..active.len()).filter(|i| active[*i]);
        let (sum, n) = on.fold((Vector2::zeros(), 0.0), |(sum, n), i| {
            let [x, y] = rays.plane[window.at(i)].map(f64::from);
            (sum + Vector2::new(x, y), n + 1.0)
        });
        let middle = Point3::from((sum / f64::max(n, 1.0)).push(1.0) / inv_z);
        let along = light - middle;
        let e1 = along.cross(&Vector3::y()).normalize();
        let across = [e1, along.cross(&e1).normalize()];
        Self { rays, window, active, light, across, distance: along.norm(), applied: Vector2::zeros() }
    }

    /// Returns by how much codewords change per mm of the offset's components; `None` where hardly any light arrives.
    /// `slope` is that of 1/z along the image's x and y, 1/mm per pixel.
    fn per_mm(&self, i: usize, inv_z: f32, slope: [f32; 2]) -> Option<Vector2<f64>> {
        let [x, y] = self.rays.plane[self.window.at(i)].map(f64::from);
        let [sx, sy] = slope.map(|s| f64::from(s * self.rays.focal_px));
        let w = f64::from(inv_z);
        // The plane N·X = 1 has 1/z = N·(x, y, 1); N points away from the camera.
        let normal = Vector3::new(sx, sy, w - x * sx - y * sy);
        let light = self.light - Point3::new(x / w, y / w, 1.0 / w);
        let facing = normal.dot(&light);
        if -facing < MIN_COSINE * normal.norm() * light.norm() {
            return None;
        }
        let more = normal / facing - Vector3::z() / light.z;
        Some(-Vector2::new(more.dot(&self.across[0]), more.dot(&self.across[1])))
    }

    /// Changes rendered codewords and their slopes, `n × 2 k`, to what the offset makes of them. `inv_z` and `slope`
    /// are those of pixels of the window.
    pub(super) fn apply(
        &self,
        rendered: &mut [f32],
        k: usize,
        inv_z: impl Fn(usize) -> f32 + Sync,
        slope: impl Fn(usize) -> [f32; 2] + Sync,
    ) {
        if self.applied == Vector2::zeros() {
            return;
        }
        let w = self.window.w;
        rendered.par_chunks_mut(2 * k * w).enumerate().for_each(|(y, row)| {
            for (x, rendered) in row.chunks_exact_mut(2 * k).enumerate().filter(|(x, _)| self.active[y * w + x]) {
                let i = y * w + x;
                if let Some(per_mm) = self.per_mm(i, inv_z(i), slope(i)) {
                    let factor = 1.0 + self.applied.dot(&per_mm).clamp(-MAX_CHANGE, MAX_CHANGE);
                    rendered.iter_mut().for_each(|v| *v *= factor as f32);
                }
            }
        });
    }

    /// Estimates the offset anew, where enough squares tell it. `rendered` has what is applied.
    pub(super) fn update(
        &mut self,
        rendered: &[f32],
        m: &Measurements,
        fractions: &LightFractions<'_>,
        inv_z: impl Fn(usize) -> f32 + Sync,
        slope: impl Fn(usize) -> [f32; 2] + Sync,
    ) {
        let side = (m.image[0] / SQUARES).max(8);
        let [w, h] = [self.window.w, self.window.h];
        let squares = [w.div_ceil(side), h.div_ceil(side)];
        let of_square = |s: usize| {
            let [left, top] = [s % squares[0] * side, s / squares[0] * side];
            let mut sum = Equations { a: Matrix3::zeros(), b: Vector3::zeros(), n: 0 };
            for y in top..(top + side).min(h) {
                for i in (y * w + left..y * w + (left + side).min(w)).filter(|i| self.active[*i]) {
                    let Some(per_mm) = self.per_mm(i, inv_z(i), slope(i)) else { continue };
                    let [bb, br] = fractions.change_by_factor(i, self.window.at(i), rendered);
                    let by = per_mm.push(1.0);
                    sum.a += f64::from(bb) * by * by.transpose();
                    sum.b += f64::from(br) * by;
                    sum.n += 1;
                }
            }
            sum
        };
        let sums: Vec<Equations> = (0..squares[0] * squares[1]).into_par_iter().map(of_square).collect();
        let told: Vec<&Equations> = sums.iter().filter(|s| s.n > side * side / 8).collect();
        if told.len() < MIN_SQUARES {
            return;
        }
        let mut a: Matrix3<f64> = told.iter().map(|s| s.a).sum();
        let mut b: Vector3<f64> = told.iter().map(|s| s.b).sum();
        let prior = [PRIOR[0] * self.distance, PRIOR[0] * self.distance, PRIOR[1]].map(|s| PIXELS_PER_SAMPLE / (s * s));
        for i in 0..3 {
            a[(i, i)] += prior[i];
        }
        for i in 0..2 {
            b[i] -= prior[i] * self.applied[i];
        }
        let Some(inverse) = a.try_inverse() else { return };
        let step = inverse * b;
        // What squares leave of their own equations: their disagreement, which neighboring pixels share.
        let spread: Matrix3<f64> = told.iter().map(|s| s.b - s.a * step).map(|s| s * s.transpose()).sum();
        let variance: Matrix2<f64> = (inverse * spread * inverse).fixed_view::<2, 2>(0, 0).into();
        let found = self.applied + step.xy();
        let Some(precision) = variance.try_inverse() else { return };
        let beyond = found.dot(&(precision * found));
        let part = (beyond / BY_CHANCE - 1.0).clamp(0.0, 1.0);
        tracing::debug!(?found, beyond, constant = step.z, squares = told.len(), "offset of the flash");
        self.applied = part * found;
    }

    /// Returns the offset, mm in the camera's frame.
    pub(super) fn mm(&self) -> Vector3<f64> {
        self.across[0] * self.applied.x + self.across[1] * self.applied.y
    }
}
