//! The bend of a board that is not flat: a paraboloid over its plane.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::Camera;
use crate::board::Corner;

/// A smooth bend of a board: its surface stands `z = ½ (κ₁ p² + κ₂ q²)` over the plane of its frame, where p and q are
/// the coordinates from `center` along two orthogonal directions of that plane. What is printed keeps its lengths along
/// the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bend {
    /// Where the surface touches the plane z = 0, board coordinates, mm.
    pub center_mm: [f64; 2],
    /// The principal curvatures, 1/mm; positive where the rim stands over the plane, toward larger z (away from
    /// a camera that the board faces).
    pub curvature_per_mm: [f64; 2],
    /// Angle of the first principal direction from the board's x axis, rad.
    pub angle_rad: f64,
}

impl Bend {
    /// Makes a bend of the surface `z = a x² + b x y + c y²`, where x and y are coordinates from `center_mm`, mm, and
    /// the coefficients are in 1/mm.
    pub fn from_quadratic(center_mm: [f64; 2], [a, b, c]: [f64; 3]) -> Self {
        let angle_rad = 0.5 * b.atan2(a - c);
        let (mean, half) = (0.5 * (a + c), 0.5 * b.hypot(a - c));
        Self { center_mm, curvature_per_mm: [2.0 * (mean + half), 2.0 * (mean - half)], angle_rad }
    }

    /// Returns the coordinates along the principal directions of a point of the plane, mm from the center.
    fn principal(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.angle_rad.sin_cos();
        let (x, y) = (x - self.center_mm[0], y - self.center_mm[1]);
        [cos * x + sin * y, cos * y - sin * x]
    }

    /// Returns the height of the surface over the plane at a point of the plane, mm.
    #[inline]
    pub fn height(&self, plane_mm: [f64; 2]) -> f64 {
        let [p, q] = self.principal(plane_mm);
        0.5 * (self.curvature_per_mm[0] * p * p + self.curvature_per_mm[1] * q * q)
    }

    /// Returns where a printed point is in the board's frame, mm. An arc's chord is shorter than the arc:
    /// p − κ² p³ / 6, up to the fifth order.
    pub fn point(&self, printed_mm: [f64; 2]) -> Point3<f64> {
        self.along_surface(printed_mm, -1.0)
    }

    /// Returns which printed point lies over a point of the plane, mm: the inverse of [`Self::point`] without its
    /// height, to the same order.
    pub fn printed(&self, plane_mm: [f64; 2]) -> [f64; 2] {
        let p = self.along_surface(plane_mm, 1.0);
        [p.x, p.y]
    }

    fn along_surface(&self, mm: [f64; 2], sign: f64) -> Point3<f64> {
        let u = self.principal(mm);
        let shift = |i: usize| sign * (self.curvature_per_mm[i] * u[i]).powi(2) * u[i] / 6.0;
        let (sin, cos) = self.angle_rad.sin_cos();
        let (dp, dq) = (shift(0), shift(1));
        Point3::new(mm[0] + cos * dp - sin * dq, mm[1] + sin * dp + cos * dq, self.height(mm))
    }

    /// Returns how far the surface stands over the chord of the largest arc within an outline (x0, y0, x1, y1), mm, along
    /// its x and its y axis.
    pub fn sagittas_mm(&self, [x0, y0, x1, y1]: [f64; 4]) -> [f64; 2] {
        let (sin, cos) = self.angle_rad.sin_cos();
        let [k1, k2] = self.curvature_per_mm;
        let (along_x, along_y) = (k1 * cos * cos + k2 * sin * sin, k1 * sin * sin + k2 * cos * cos);
        [along_x * (x1 - x0).powi(2) / 8.0, along_y * (y1 - y0).powi(2) / 8.0]
    }

    /// Returns the corners of a board of this bend at a pose as they would be seen if it were flat. A pose that explains
    /// them explains the bent board; since it moves what they are computed with, repeat it with the new pose.
    pub fn flattened(&self, corners: &[Corner], camera: &Camera, pose: &Isometry3<f64>) -> Vec<Corner> {
        let flat = |c: &Corner| {
            let [x, y] = c.board_mm;
            let seen = |p: Point3<f64>| camera.project(&(pose * p));
            let px = match (seen(Point3::new(x, y, 0.0)), seen(self.point(c.board_mm))) {
                (Some(flat), Some(bent)) => [c.px[0] + flat[0] - bent[0], c.px[1] + flat[1] - bent[1]],
                _ => c.px,
            };
            Corner { px, ..*c }
        };
        corners.iter().map(flat).collect()
    }
}

/// What a sweep tells of the board's flatness.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Flatness {
    /// The bend, where it is taken into account.
    pub bend: Option<Bend>,
    /// Height of the board's surface over its chords along x and y, mm, as estimated; positive where the middle stands
    /// out toward the camera.
    pub sagitta_mm: [f64; 2],
    /// Standard deviation of both, mm, errors of the camera's calibration included.
    pub sigma_mm: [f64; 2],
    /// Squared distance from flat in standard deviations.
    pub significance: f64,
    /// Fraction of the squared residuals that the bend of one half of the positions takes from the other half, the
    /// smaller of both ways; negative where it adds to them.
    pub gain: f64,
}

/// Returns the derivatives of a bent surface's point by the coefficients of [`Bend::from_quadratic`], mm per 1/mm, where
/// the surface is nearly flat: heights alone.
pub(super) fn by_quadratic(center_mm: [f64; 2], [x, y]: [f64; 2]) -> [Vector3<f64>; 3] {
    let (x, y) = (x - center_mm[0], y - center_mm[1]);
    [x * x, x * y, y * y].map(|height| Vector3::new(0.0, 0.0, height))
}
