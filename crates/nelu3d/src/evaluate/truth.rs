//! The truth of a scene.

/// What the scene really is: the content of a `truth/` folder. Maps are `height × width`, row by row.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Width of the maps, pixels.
    pub width: usize,
    /// Height of the maps, pixels.
    pub height: usize,
    /// Camera z of the first surface, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// Where depth is finite and the light source sees the point.
    pub mask: Vec<bool>,
}

/// A truth folder that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// Two maps differ in size.
    #[error("{0}")]
    Size(String),
}
