//! The values of a camera file, before they are checked.

/// What any of the formats holds, with the keys it was found under.
pub(super) struct Calibration {
    pub(super) width: (String, usize),
    pub(super) height: (String, usize),
    pub(super) matrix: (String, Vec<f64>),
    pub(super) distortion: (String, Vec<f64>),
    pub(super) rotation: Option<(String, Vec<f64>)>,
    pub(super) translation: Option<(String, Vec<f64>)>,
}
