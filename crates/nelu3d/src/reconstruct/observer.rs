//! Watching a surface while it is being found.

/// Sees every intermediate surface of a reconstruction. It cannot change anything, and its own time is not counted as the
/// reconstruction's.
pub trait Observer {
    /// The surface after `iteration` of a stage: camera z per pixel, mm; NaN where there is none.
    fn surface(&mut self, stage: Stage, iteration: usize, depth: &[f32]);
}

/// Where a surface comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Decoded from the cost volume.
    Decode,
    /// After a step of the refinement.
    Refine,
    /// Finished: what has no consistent code is left out.
    Result,
}
