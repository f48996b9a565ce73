//! Linear images: what a capture is once it has been read.
//!
//! A file is first decoded to the sensor's codes ([`decode()`]), then made linear by [`Raw::linearize`], which
//! subtracts the black level, scales by the saturation and demosaics. [`write_png8`] and [`write_png16`] go the other
//! way. [`Apng`] is for pictures that move.

mod apng;
pub(crate) mod bayer;
mod bilinear;
mod box_mean;
mod decode;
mod gaussian_blur;
mod response;
mod write;
mod write_float;

pub use apng::Apng;
pub use bayer::demosaic;
pub use bilinear::bilinear;
pub use box_mean::box_mean;
pub use decode::{Depth, ImageFileError, Raw, RawData, decode, decode_bytes, read_any};
pub(crate) use decode::{follow, read_image_file};
pub use gaussian_blur::gaussian_blur;
pub use response::Response;
pub(crate) use write::{Codes, write_png};
pub use write::{encode_rgb8, write_gray8, write_gray16, write_png8, write_png16, write_raw_png, write_rgb8};
pub use write_float::{write_exr_f32, write_tiff_f32};

/// How the sensor delivers color.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One channel.
    Mono,
    /// Three channels a pixel.
    Rgb,
    /// A raw mosaic: the colors of the 2×2 cell at the top left, row by row (0 red, 1 green, 2 blue).
    Bayer([u8; 4]),
}

impl Channels {
    /// Every way there is.
    pub const ALL: [Channels; 6] = [
        Channels::Mono,
        Channels::Rgb,
        Channels::Bayer([0, 1, 1, 2]),
        Channels::Bayer([2, 1, 1, 0]),
        Channels::Bayer([1, 0, 2, 1]),
        Channels::Bayer([1, 2, 0, 1]),
    ];

    /// Returns the number of channels of an image once read: 1 or 3.
    pub fn count(self) -> usize {
        if self == Channels::Mono { 1 } else { 3 }
    }

    /// Returns the number of channels in the file: 3 for [`Channels::Rgb`], else 1 (a mosaic has one value a pixel).
    pub fn in_file(self) -> usize {
        if self == Channels::Rgb { 3 } else { 1 }
    }

    /// Returns the name in rig.toml, as `bayer-rggb`.
    pub fn name(self) -> String {
        match self {
            Channels::Mono => "mono".into(),
            Channels::Rgb => "rgb".into(),
            Channels::Bayer(cell) => {
                let letters: String = cell.iter().map(|&c| ['r', 'g', 'b'][usize::from(c)]).collect();
                format!("bayer-{letters}")
            }
        }
    }

    /// Returns the inverse of [`Channels::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }
}

/// A linear image of interleaved channels. Values are (code − black level) / (saturation − black level); a value ≥ 1 is
/// clipped (a demosaiced value is ≥ 1 when any mosaic pixel it was made from was clipped). Noise around the black level
/// may be negative: it is kept, so that means stay unbiased.
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
    /// Makes an image of zeros.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// Returns the channels of pixel (x, y).
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let i = (y * self.width + x) * self.channels;
        &self.data[i..i + self.channels]
    }

    /// Returns the image of a camera whose pixels are `block × block` of this one's: means, and where one of them is
    /// clipped (1 or more), the largest. What is left over at the right and the lower edge is dropped.
    pub fn binned(&self, block: usize) -> Self {
        let (width, height, n) = (self.width / block, self.height / block, self.channels);
        let mut out = Self::new(width, height, n);
        let norm = 1.0 / (block * block) as f32;
        for y in 0..height {
            let rows = &self.data[y * block * self.width * n..][..block * self.width * n];
            let to = &mut out.data[y * width * n..][..width * n];
            let mut largest = vec![0.0f32; width * n];
            for row in rows.chunks_exact(self.width * n) {
                for (x, pixels) in row.chunks_exact(block * n).enumerate() {
                    for (i, v) in pixels.iter().enumerate() {
                        to[x * n + i % n] += norm * v;
                        largest[x * n + i % n] = largest[x * n + i % n].max(*v);
                    }
                }
            }
            to.iter_mut().zip(&largest).filter(|(_, largest)| **largest >= 1.0).for_each(|(to, v)| *to = *v);
        }
        out
    }

    /// Returns the mean over channels of each pixel, `height × width`: what a detector looks at.
    pub fn to_gray(&self) -> Vec<f32> {
        if self.channels == 1 {
            return self.data.clone();
        }
        let n = self.channels as f32;
        self.data.chunks_exact(self.channels).map(|p| p.iter().sum::<f32>() / n).collect()
    }
}
