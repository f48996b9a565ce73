//! The map from space to the unit cube of a spline.

/// A projective frame: a point whose coordinates along the frame's axes are y has the unit coordinates
/// `q_i = (y_i / (1 + kappa · y_2) − lo_i) · scale_i`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectiveFrame {
    /// One over the distance from the origin to the center in which the lines of constant (q_0, q_1) meet; 0 for
    /// parallel lines.
    pub kappa: f64,
    /// Lower corner of the box that maps to the unit cube, after the division.
    pub lo: [f64; 3],
    /// One over the lengths of that box.
    pub scale: [f64; 3],
}

impl ProjectiveFrame {
    /// The frame whose unit coordinates are the coordinates y themselves.
    pub const UNIT: Self = Self { kappa: 0.0, lo: [0.0; 3], scale: [1.0; 3] };

    /// Returns the unit coordinates of a point. A point behind the center is far outside the cube.
    #[inline(always)]
    pub fn to_unit(&self, y: [f64; 3]) -> [f32; 3] {
        let s = 1.0 / (1.0 + self.kappa * y[2]).max(1e-6);
        std::array::from_fn(|i| ((y[i] * s - self.lo[i]) * self.scale[i]) as f32)
    }

    /// Returns h with `q = h_0..2 / h_3` of the point with homogeneous coordinates (y, `one`): 1 for a point, 0 for a
    /// direction. A point is behind the center where h_3 is not positive.
    pub fn homogeneous(&self, y: [f64; 3], one: f64) -> [f64; 4] {
        let s = one + self.kappa * y[2];
        let q = |i: usize| (y[i] - self.lo[i] * s) * self.scale[i];
        [q(0), q(1), q(2), s]
    }
}
