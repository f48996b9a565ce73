//! Intensities of an image whose means are those of the light, and what their noise is judged by.

use nelu3d_scan::Image;
use nelu3d_scan::image::box_mean;

use super::noise::NoiseModel;

/// Radius of the squares of pixels, px.
const RADIUS: usize = 1;
/// Pixels of such a square.
const PIXELS: f32 = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
/// Standard deviations of noise by which a pixel may differ from the mean around it.
const ALIKE: f32 = 4.0;

/// The intensities of an image, `height × width × channels`.
#[derive(Clone, Debug)]
pub struct Intensities {
    /// As measured, without what clipping in the dark adds to their means ([`NoiseModel::unclipped`]).
    pub own: Vec<f32>,
    /// The means of the eight pixels around each; its own where the two differ by more than noise: at an edge, on a fine
    /// stripe, in a texture.
    ///
    /// It is what a weight has to be made from. A variance that follows a pixel's own noise gives more weight to what
    /// noise has made dark, or has divided by a white that it made bright, and all weighted means come out too dark: by
    /// about three parts in a thousand where white is a thousand electrons.
    pub mean: Vec<f32>,
}

impl Intensities {
    /// Takes the intensities of an image with this noise.
    pub fn new(image: &Image, noise: &NoiseModel) -> Self {
        let (w, h, channels) = (image.width, image.height, image.channels);
        let (mut own, mut mean) = (image.data.clone(), image.data.clone());
        let mut ones = vec![1.0; w * h];
        box_mean(&mut ones, w, h, RADIUS);
        for c in 0..channels {
            let mut around: Vec<f32> = image.data.iter().skip(c).step_by(channels).copied().collect();
            box_mean(&mut around, w, h, RADIUS);
            for ((mean, around), part) in mean.iter_mut().skip(c).step_by(channels).zip(&around).zip(&ones) {
                // A square of one pixel has no others.
                let others = (part * PIXELS - 1.0).max(1.0);
                let around = (around * PIXELS - *mean) / others;
                let difference = *mean - around;
                if difference * difference <= ALIKE * ALIKE * noise.variance(around) {
                    *mean = around;
                }
            }
        }
        if noise.darkest.is_some() {
            for (own, mean) in own.iter_mut().zip(&mut mean) {
                let unclipped = noise.unclipped(*mean);
                *own += unclipped - *mean;
                *mean = unclipped;
            }
        }
        Self { own, mean }
    }
}
