//! Where in the projected image the pixels were lit from.

use nelu3d_scan::pattern::Axis;

use nelu3d::surface::PixelStatus;

/// Where along one axis of the projected image the pixels were lit from.
#[derive(Clone, Debug)]
pub(crate) struct Coordinate {
    pub(crate) axis: Axis,
    /// Projector px, one a pixel; NaN where it is unknown.
    pub(crate) at: Vec<f32>,
    /// Standard deviation of the coordinate, projector px.
    pub(crate) sigma: Vec<f32>,
}

/// What a decoder found.
#[derive(Clone, Debug)]
pub(crate) struct DecodedCoordinates {
    /// One coordinate, or both.
    pub(crate) coordinates: Vec<Coordinate>,
    /// The status of every pixel so far.
    pub(crate) status: Vec<PixelStatus>,
}

/// Says in words why no pixel has a depth.
pub(crate) fn describe_no_depth(status: &[PixelStatus]) -> String {
    let rejected = PixelStatus::describe_rejections(status, "the depth range");
    format!("{rejected}; check the exposure, and that projector.json and patterns/ are those of this scene")
}
