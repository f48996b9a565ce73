//! One bit of a code, as the pixels saw it.

use crate::captured::Captured;

/// One bit's difference from its threshold, in units of white − black: positive is bright.
pub(super) struct Bit<'a> {
    pub(super) p: std::borrow::Cow<'a, [f32]>,
    pub(super) inverse: Option<std::borrow::Cow<'a, [f32]>>,
}

impl<'a> Bit<'a> {
    pub(super) fn new(captured: &'a Captured, image: usize) -> Self {
        let has = captured.planes.iter().any(|p| p.image == image && !p.inverse.is_empty());
        Self { p: captured.gray(image, false), inverse: has.then(|| captured.gray(image, true)) }
    }

    #[inline]
    pub(super) fn at(&self, i: usize) -> f32 {
        match &self.inverse {
            // Half of the difference, so that both kinds have the same scale.
            Some(inverse) => 0.5 * (self.p[i] - inverse[i]),
            None => self.p[i] - 0.5,
        }
    }

    /// Returns the standard deviation of [`Self::at`] at a pixel whose normalized intensity has this one.
    pub(super) fn sigma(&self, sigma: f32) -> f32 {
        if self.inverse.is_some() { sigma * std::f32::consts::FRAC_1_SQRT_2 } else { sigma }
    }
}
