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
//! codeword by as much in half a millimeter. An offset along L has no effect.

use nalgebra::{Point3, Vector2, Vector3};

use crate::color_field::CameraRays;
use crate::reconstruct::refine::window::Window;

/// Least cosine between light and normal: beyond it next to nothing of the light arrives.
const MIN_COSINE: f64 = 0.15;
/// Largest change of a codeword.
const MAX_CHANGE: f64 = 0.1;

/// The flash, and where the patterns' light is.
pub(super) struct Flash<'a> {
    rays: &'a CameraRays,
    window: &'a Window,
    /// The patterns' light, mm.
    light: Point3<f64>,
    /// Unit vectors across the light's mean direction.
    across: [Vector3<f64>; 2],
    /// Mean distance to the light, mm.
    pub(super) distance: f64,
    /// The offset that is applied, mm along `across`.
    pub(super) applied: Vector2<f64>,
}

impl<'a> Flash<'a> {
    /// A flash where the patterns' light is, at `light`, of a surface at the active pixels whose mean inverse depth is
    /// `inv_z`, 1/mm.
    pub(super) fn new(
        rays: &'a CameraRays,
        window: &'a Window,
        active: &[bool],
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
        Self { rays, window, light, across, distance: along.norm(), applied: Vector2::zeros() }
    }

    /// Returns by how much the factor γ of pixel `i` of the window changes per mm of the offset's components; `None`
    /// where hardly any light arrives. `inv_z` is its 1/z, 1/mm, `slope` that of 1/z along x and y, 1/mm per pixel.
    pub(super) fn per_mm(&self, i: usize, inv_z: f32, slope: [f32; 2]) -> Option<Vector2<f64>> {
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

    /// Returns the factor γ of a pixel's codeword; arguments as of [`Self::per_mm`].
    pub(super) fn factor(&self, i: usize, inv_z: f32, slope: [f32; 2]) -> f32 {
        let change = self.per_mm(i, inv_z, slope).map_or(0.0, |per_mm| self.applied.dot(&per_mm));
        (1.0 + change.clamp(-MAX_CHANGE, MAX_CHANGE)) as f32
    }

    /// Returns the offset, mm in the camera's frame.
    pub(super) fn mm(&self) -> Vector3<f64> {
        // No negative zeros.
        (self.across[0] * self.applied.x + self.across[1] * self.applied.y).add_scalar(0.0)
    }
}
