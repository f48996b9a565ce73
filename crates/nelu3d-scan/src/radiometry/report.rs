//! What a measurement of a response says of itself.

use serde::Serialize;

/// A family of curves that was tried.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CandidateCurve {
    /// Its name.
    pub name: &'static str,
    /// Number of its parameters.
    pub parameters: usize,
    /// By how much images that were left out differ from what they should show, as a part of the noise that is expected.
    pub held_out: f64,
    /// Whether it was chosen.
    pub chosen: bool,
}

/// What a measurement of a response says of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResponseReport {
    /// The families that were tried, simplest first.
    pub candidates: Vec<CandidateCurve>,
    /// Number of relations, each in one part of the picture and one channel.
    pub relations: usize,
    /// Codes that were seen, as parts of the scale: from most of the darkest to most of the brightest. Beyond, the curve
    /// goes on as its family does.
    pub range: [f64; 2],
    /// Typical difference between images and what they should show, percent of their light.
    pub adds_up_percent: f64,
    /// The same if codes were taken to be light.
    pub adds_up_linear_percent: f64,
    /// Largest standard error of the curve within the range, percent of its height there.
    pub standard_error_percent: f64,
    /// Largest distance of the curve from a straight line within the range, percent of its height there.
    pub from_linear_percent: f64,
    /// Power of the code that light follows in the middle of the range.
    pub gamma: f64,
}
