//! Linear images: what a capture is once it has been read.

/// A linear image of interleaved channels. Values are (code − black level) / (saturation − black level); a value ≥ 1 is
/// clipped (a demosaiced value is ≥ 1 when any mosaic pixel it was made from was clipped).
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// 1 or 3.
    pub channels: usize,
    /// `height × width × channels` values, row by row.
    pub data: Vec<f32>,
}

impl Image {
    /// An image of zeros.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// The channels of pixel (x, y).
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let i = (y * self.width + x) * self.channels;
        &self.data[i..i + self.channels]
    }

    /// The mean over channels of each pixel, `height × width`: what a detector looks at.
    pub fn to_gray(&self) -> Vec<f32> {
        if self.channels == 1 {
            return self.data.clone();
        }
        let n = self.channels as f32;
        self.data.chunks_exact(self.channels).map(|p| p.iter().sum::<f32>() / n).collect()
    }
}
