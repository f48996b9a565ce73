//! The 8-bit image that the coarse detectors look at.

use calib_targets_core::GrayImageView;

use crate::statistics::order_statistic;

/// A reduced image of 8 bits, the square root of the linear one: dark parts of a board stay readable.
pub(super) struct Decimated {
    pub(super) data: Vec<u8>,
    pub(super) width: usize,
    pub(super) height: usize,
    factor: usize,
}

impl Decimated {
    /// Takes means of `factor × factor` pixels of a linear image, `top` and above being white.
    pub(super) fn new(gray: &[f32], width: usize, height: usize, factor: usize, top: f32) -> Self {
        let (w, h) = ((width / factor).max(1), (height / factor).max(1));
        let n = (factor * factor) as f32;
        let mut data = Vec::with_capacity(w * h);
        for y in 0..h {
            for x in 0..w {
                let mut sum = 0.0;
                for row in gray[y * factor * width..].chunks(width).take(factor) {
                    sum += row[x * factor..].iter().take(factor).sum::<f32>();
                }
                // A NaN casts to 0.
                data.push((255.0 * (sum / (n * top)).clamp(0.0, 1.0).sqrt() + 0.5) as u8);
            }
        }
        Self { data, width: w, height: h, factor }
    }

    pub(super) fn view(&self) -> GrayImageView<'_> {
        GrayImageView { width: self.width, height: self.height, data: &self.data }
    }

    /// Takes a pixel of the reduced image to one of the full image.
    pub(super) fn full(&self, p: [f64; 2]) -> [f64; 2] {
        let f = self.factor as f64;
        p.map(|v| f * v + 0.5 * (f - 1.0))
    }

    /// Returns the value at the nearest pixel, `None` outside.
    pub(super) fn at(&self, p: [f64; 2]) -> Option<u8> {
        let (x, y) = (p[0].round(), p[1].round());
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then(|| self.data[y as usize * self.width + x as usize])
    }
}

/// Returns the linear value that is to become white: the 99th percentile, so that a highlight does not darken the
/// board. `None` for a black image.
pub(super) fn stretch(gray: &[f32]) -> Option<f32> {
    let stride = (gray.len() / 200_000).max(1);
    let mut sample: Vec<f32> = gray.iter().step_by(stride).copied().filter(|v| v.is_finite()).collect();
    if sample.is_empty() {
        return None;
    }
    let k = sample.len() * 99 / 100;
    let top = order_statistic(&mut sample, k);
    (top > 1e-6).then_some(top.min(1.0))
}
