//! How many coefficients a lens has.

/// Numbers of coefficients of OpenCV's distortion that are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LensModel {
    /// None: a pinhole.
    Pinhole,
    /// k1, k2, p1, p2.
    Four,
    /// k1, k2, p1, p2, k3.
    Five,
    /// k1, k2, p1, p2, k3, k4, k5, k6: the rational model.
    Eight,
}

impl LensModel {
    /// All models, the simplest first.
    pub const ALL: [LensModel; 4] = [LensModel::Pinhole, LensModel::Four, LensModel::Five, LensModel::Eight];

    /// Returns the number of coefficients.
    pub fn coefficients(self) -> usize {
        match self {
            LensModel::Pinhole => 0,
            LensModel::Four => 4,
            LensModel::Five => 5,
            LensModel::Eight => 8,
        }
    }
}
