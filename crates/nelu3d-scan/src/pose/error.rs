/// Why a pose, or the poses of a sweep, cannot be solved for.
#[derive(Debug, thiserror::Error)]
pub enum PoseError {
    /// The pose of a plane takes four corners.
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
    #[error(
        "only {usable} of {total} board positions are usable, and at least 3 are needed ({}); show the whole board at \
         more positions, and check that it is the one described in rig.toml",
        list(reasons)
    )]
    TooFewPositions {
        /// Positions with a pose.
        usable: usize,
        /// Positions in all.
        total: usize,
        /// Position and reason of each that is not usable.
        reasons: Vec<(String, String)>,
    },
}

/// Largest number of different reasons in a message.
const MAX_REASONS: usize = 3;

/// Lists every reason once, with the positions it holds for, the most frequent first.
fn list(reasons: &[(String, String)]) -> String {
    let mut groups: Vec<(&str, Vec<&str>)> = Vec::new();
    for (position, reason) in reasons {
        match groups.iter_mut().find(|(r, _)| r == reason) {
            Some((_, positions)) => positions.push(position),
            None => groups.push((reason, vec![position])),
        }
    }
    groups.sort_by_key(|(_, positions)| std::cmp::Reverse(positions.len()));
    let of = |(reason, positions): &(&str, Vec<&str>)| match positions.as_slice() {
        [one] => format!("{one}: {reason}"),
        [first, .., last] if positions.len() > 3 => format!("{first} to {last}, {} in all: {reason}", positions.len()),
        some => format!("{}: {reason}", some.join(", ")),
    };
    let mut told: Vec<String> = groups.iter().take(MAX_REASONS).map(of).collect();
    let more: usize = groups.iter().skip(MAX_REASONS).map(|(_, positions)| positions.len()).sum();
    if more > 0 {
        told.push(format!("{more} more for other reasons"));
    }
    if told.is_empty() {
        told.push("rig.toml gives no more poses".into());
    }
    told.join(", ")
}
