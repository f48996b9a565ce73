//! The linear image that corners are localized in.

/// A linear image.
pub(super) struct Pixels<'a> {
    pub(super) data: &'a [f32],
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Pixels<'_> {
    /// Returns the value at the nearest pixel, `None` outside or where it is not finite.
    pub(super) fn nearest(&self, p: [f64; 2]) -> Option<f32> {
        let (x, y) = (p[0].round(), p[1].round());
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        let value = inside.then(|| self.data[y as usize * self.width + x as usize]);
        value.filter(|v| v.is_finite())
    }
}
