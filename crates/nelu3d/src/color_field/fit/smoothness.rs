//! The smoothness of the fitted spline.

use std::ops::Range;

use super::defocus::Defocus;

/// Weights of the penalties on differences of coefficients, as fractions of a typical node's sample weight: how smooth
/// the spline is where samples do not say otherwise.
#[derive(Clone, Debug)]
pub struct Smoothness {
    /// Weight of second differences across (a, b).
    pub across: f32,
    /// Weight of second differences along w.
    pub along: f32,
    /// Weight of first differences along w: a codeword changes along a ray of light by defocus only. 0 in the camera's
    /// frame, where codewords change along w as they do across.
    pub slope_along: f32,
    /// Factors of these weights along a, b and w, channel by channel.
    pub of_channels: Vec<[f32; 3]>,
    /// How patterns go out of focus along w, if that is known: what is smooth is then what they are without it.
    pub defocus: Option<Defocus>,
}

impl Smoothness {
    /// Returns the smoothness of a spline with `part` times fewer cells across. Second differences across are `part`²
    /// times larger there, at `part`² times fewer nodes, each with `part`² times the samples' weight. What samples
    /// leave undetermined is smooth at all levels: the factors across do not fall below 1. Out of focus goes the finest
    /// alone, which shows what the defocus makes of the patterns.
    #[must_use]
    pub fn of_coarser(&self, part: usize) -> Self {
        let of_part = 1.0 / (part as f32).powi(4);
        let coarser = |factor: f32| (factor * of_part).max(factor.min(1.0));
        let of_channels = self.of_channels.iter().map(|[a, b, w]| [coarser(*a), coarser(*b), *w]).collect();
        let defocus = self.defocus.clone().filter(|_| part == 1);
        Self { of_channels, defocus, ..*self }
    }

    /// Returns the smoothness of some of the channels.
    #[must_use]
    pub fn part(&self, channels: Range<usize>) -> Self {
        let defocus = self
            .defocus
            .as_ref()
            .map(|defocus| Defocus { of_channels: defocus.of_channels[channels.clone()].to_vec(), ..defocus.clone() });
        Self { of_channels: self.of_channels[channels].to_vec(), defocus, ..*self }
    }
}
