//! The smoothness of the fitted spline.

/// Weights of the penalty on second differences, as fractions of a typical node's sample weight: how smooth the spline
/// is where samples do not say otherwise.
#[derive(Clone, Copy, Debug)]
pub struct Smoothness {
    /// Weight across (a, b).
    pub across: f32,
    /// Weight along w.
    pub along: f32,
}
