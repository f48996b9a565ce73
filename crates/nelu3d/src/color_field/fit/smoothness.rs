//! The smoothness of the fitted spline.

/// Weights of the penalties on differences of coefficients, as fractions of a typical node's sample weight: how smooth
/// the spline is where samples do not say otherwise.
#[derive(Clone, Debug)]
pub struct Smoothness {
    /// Weight of second differences across (a, b).
    pub across: f32,
    /// Weight of second differences along w.
    pub along: f32,
    /// Weight of first differences along w: a codeword changes along a ray of light by defocus only.
    pub slope_along: f32,
    /// Factor of all three, channel by channel.
    pub of_channels: Vec<f32>,
}
