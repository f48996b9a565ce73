/// Why a board cannot be used, or was not found in an image.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// No predefined dictionary has this name.
    #[error("there is no ArUco dictionary {name:?}; name one of {}", known.join(", "))]
    UnknownDictionary {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: &'static [&'static str],
    },
    /// The description of the board contradicts itself.
    #[error("the board cannot be printed as described: {reason}; correct [board] in rig.toml")]
    Invalid {
        /// What is wrong.
        reason: String,
    },
    /// The board does not go on this paper.
    #[error("the board cannot be printed: {reason}; take larger paper or smaller margins, or a smaller board")]
    Paper {
        /// What does not fit.
        reason: String,
    },
    /// The image has no pixels, or not as many as its size says.
    #[error("an image of {width} x {height} pixels cannot have {len} values")]
    ImageSize {
        /// Width, px.
        width: usize,
        /// Height, px.
        height: usize,
        /// Values given.
        len: usize,
    },
    /// The camera's image has another size than the image looked at.
    #[error(
        "the image has {width} x {height} pixels, the camera's intrinsics are for {camera_width} x {camera_height}; \
         use intrinsics of this image size"
    )]
    CameraSize {
        /// Width of the image, px.
        width: usize,
        /// Height of the image, px.
        height: usize,
        /// Width the intrinsics are for, px.
        camera_width: usize,
        /// Height the intrinsics are for, px.
        camera_height: usize,
    },
    /// The board is not in the image, or too little of it.
    #[error("the board was not found: {reason}")]
    NotFound {
        /// What was seen instead.
        reason: String,
    },
}

impl BoardError {
    pub(crate) fn invalid(reason: impl Into<String>) -> Self {
        Self::Invalid { reason: reason.into() }
    }

    pub(crate) fn not_found(reason: impl Into<String>) -> Self {
        Self::NotFound { reason: reason.into() }
    }
}
