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

use std::borrow::Cow;

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
        let (stride, norm) = (self.width * n, 1.0 / (block * block) as f32);
        let mut data = Vec::with_capacity(width * height * n);
        // Down, and then along a row.
        let (mut sums, mut largest) = (vec![0.0f32; stride], vec![0.0f32; stride]);
        for rows in self.data.chunks_exact(block * stride).take(height) {
            sums.copy_from_slice(&rows[..stride]);
            largest.copy_from_slice(&rows[..stride]);
            for row in rows.chunks_exact(stride).skip(1) {
                for ((sum, largest), v) in sums.iter_mut().zip(&mut largest).zip(row) {
                    *sum += v;
                    *largest = largest.max(*v);
                }
            }
            for (sums, largest) in sums.chunks_exact(block * n).zip(largest.chunks_exact(block * n)) {
                data.extend((0..n).map(|c| {
                    let of_channel = (c..block * n).step_by(n);
                    let largest = of_channel.clone().map(|i| largest[i]).fold(f32::NEG_INFINITY, f32::max);
                    if largest >= 1.0 { largest } else { norm * of_channel.map(|i| sums[i]).sum::<f32>() }
                }));
            }
        }
        Self { width, height, channels: n, data }
    }

    /// Returns the mean over channels of each pixel, `height × width`: what a detector looks at.
    pub fn to_gray(&self) -> Cow<'_, [f32]> {
        if self.channels == 1 {
            return Cow::Borrowed(&self.data);
        }
        let n = self.channels as f32;
        Cow::Owned(self.data.chunks_exact(self.channels).map(|p| p.iter().sum::<f32>() / n).collect())
    }
}
