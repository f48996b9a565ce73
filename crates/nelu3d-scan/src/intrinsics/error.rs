//! Why a camera cannot be calibrated.

/// Why a camera cannot be calibrated from its images.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IntrinsicsError {
    /// Too few images show the board.
    #[error(
        "only {usable} of {total} images show enough of the board, and at least {needed} are needed{}; take more, with \
         the board at several angles",
        first_reason(reasons)
    )]
    TooFewViews {
        /// Images with a board.
        usable: usize,
        /// Images in all.
        total: usize,
        /// Images needed.
        needed: usize,
        /// Image and reason of each that does not show it.
        reasons: Vec<(String, String)>,
    },
    /// No camera explains the corners.
    #[error(
        "no camera explains the corners seen in {views} images: check that they show the board that is described, and \
         that the camera's zoom and focus stayed"
    )]
    NoSolution {
        /// Images with a board.
        views: usize,
    },
    /// The images leave the focal length open.
    #[error(
        "the focal length cannot be determined from these images: it is {focal_px:.0} ± {sigma_px:.0} px, {reason}; \
         {remedy}"
    )]
    FocalLength {
        /// The best guess, px.
        focal_px: f64,
        /// Its standard deviation, px.
        sigma_px: f64,
        /// What the images lack.
        reason: String,
        /// What to add.
        remedy: String,
    },
    /// The images leave the principal point open.
    #[error(
        "the principal point cannot be determined from these images: it is uncertain by {sigma_px:.0} px; {remedy}"
    )]
    PrincipalPoint {
        /// The larger of its standard deviations, px.
        sigma_px: f64,
        /// What to add.
        remedy: String,
    },
}

fn first_reason(reasons: &[(String, String)]) -> String {
    reasons.first().map_or_else(String::new, |(name, reason)| format!(" ({name}: {reason})"))
}
