/// Why a pose, or the poses of a sweep, cannot be told.
#[derive(Debug, thiserror::Error)]
pub enum PoseError {
    /// A plane's pose takes four corners.
    #[error("{found} corners are too few for a pose: at least 4 are needed")]
    TooFewCorners {
        /// Corners given.
        found: usize,
    },
    /// The corners lie on one line of the board, or of the image.
    #[error("the {found} corners lie on one line, which leaves the pose open: show more of the board")]
    Collinear {
        /// Corners given.
        found: usize,
    },
    /// No pose in front of the camera explains the corners.
    #[error("no pose in front of the camera explains the {found} corners: check the intrinsics and the board's layout")]
    NoSolution {
        /// Corners given.
        found: usize,
    },
    /// A coordinate is not a number.
    #[error("corner {index} has a coordinate that is not finite")]
    NotFinite {
        /// Which corner.
        index: usize,
    },
    /// The sweep has too few usable positions.
    #[error("only {usable} of {total} board positions are usable, at least 3 are needed{}", list(reasons))]
    TooFewPositions {
        /// Positions with a pose.
        usable: usize,
        /// Positions in all.
        total: usize,
        /// Position and reason of each that is not usable.
        reasons: Vec<(String, String)>,
    },
}

fn list(reasons: &[(String, String)]) -> String {
    reasons.iter().map(|(p, r)| format!("; {p}: {r}")).collect()
}
