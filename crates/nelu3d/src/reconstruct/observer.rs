//! Observation of a surface while it is being reconstructed.

/// Receives every intermediate surface of a reconstruction. It cannot change the result, and its own time does not
/// count as the reconstruction's.
pub trait Observer {
    /// Receives the surface after `iteration` of a stage: camera z per pixel, mm; NaN where there is none.
    fn surface(&mut self, stage: Stage, iteration: usize, depth: &[f32]);
}

/// The stage that an intermediate surface comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// The surface was decoded from the cost volume.
    Decode,
    /// The surface is that after a step of the refinement.
    Refine,
    /// The surface is finished: pixels without support are rejected.
    Result,
}
