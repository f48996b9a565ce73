//! The change of brightness of a white image's points from frame to frame.

use nelu3d_scan::Image;
use nelu3d_scan::image::box_mean;
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::resample::cubic;
use super::vector_map::VectorMap;

/// Squared difference between white images, as a multiple of the typical one, at which the neighbors count half.
const AGREEMENT: f32 = 8.0;
/// Every how many pixels the typical difference is sampled.
const SAMPLE_STRIDE: usize = 37;
/// Linear intensity below which a pixel is not used.
pub(super) const MIN_LIGHT: f32 = 0.02;
/// Radius of the squares over which the change of brightness is averaged, px.
const TREND_RADIUS: usize = 1;

/// The brightness of a white image's points over time, from three white images.
pub struct Brightness {
    /// Brightness at the image's own time, with less noise.
    pub(super) now: Image,
    /// Change of brightness per frame.
    pub(super) trend: Image,
}

impl Brightness {
    /// Estimates brightness from a white image, its neighbors before and after, and the motion of its points to them,
    /// px. Where the three do not show the same, a point's brightness is that of its own image, and does not change.
    pub(super) fn estimate(white: &Image, neighbors: [&Image; 2], motion: [&VectorMap<2>; 2]) -> Self {
        let channels = white.channels;
        let warped = [0, 1].map(|n| warp(white, neighbors[n], motion[n]));
        let [early, late] = &warped;
        let sampled = (0..white.width * white.height).step_by(SAMPLE_STRIDE);
        let mut differences: Vec<f32> = sampled
            .filter(|i| white.data[i * channels] > MIN_LIGHT)
            .map(|i| curvature(white, &warped, i))
            .filter(|difference| difference.is_finite())
            .collect();
        let typical = median(&mut differences).unwrap_or(0.0);
        let (mut now, mut trend) = (white.clone(), Image::new(white.width, white.height, channels));
        now.data
            .par_chunks_mut(channels)
            .zip(trend.data.par_chunks_mut(channels))
            .enumerate()
            .with_min_len(white.width)
            .for_each(|(i, (now, trend))| {
                if !is_lit(now, MIN_LIGHT) {
                    return;
                }
                // All channels or none: a color is not to be mixed of two surfaces.
                let weight = 1.0 / (1.0 + (curvature(white, &warped, i) / (AGREEMENT * typical.max(1e-9))).powi(2));
                for c in 0..channels {
                    let (early, late) = (early.data[i * channels + c], late.data[i * channels + c]);
                    now[c] += weight * 2.0 / 3.0 * (0.5 * (early + late) - now[c]);
                    trend[c] = weight * 0.5 * (late - early);
                }
            });
        Self { now, trend: smoothed(trend) }
    }
}

/// Returns whether a pixel has more light than `least` in any channel. Most of an image is often dark, and nobody needs
/// its brightness.
pub(super) fn is_lit(px: &[f32], least: f32) -> bool {
    px.iter().any(|v| *v > least)
}

/// Returns a neighbor's brightness at the points of a white image, given their motion to it, px; 0 where the image is
/// dark.
fn warp(white: &Image, neighbor: &Image, motion: &VectorMap<2>) -> Image {
    let (w, channels) = (white.width, white.channels);
    let mut out = Image::new(w, white.height, channels);
    out.data.par_chunks_mut(w * channels).enumerate().for_each(|(y, row)| {
        for (x, px) in row.chunks_exact_mut(channels).enumerate() {
            if is_lit(white.pixel(x, y), MIN_LIGHT) {
                let [x, y] = [x as f32, y as f32];
                let [u, v] = motion.at([x, y]);
                cubic(neighbor, [x + u, y + v], px);
            }
        }
    });
    out
}

/// Returns the squared difference of pixel `i` from the mean of both neighbors, largest over channels, relative to the
/// light's own noise, whose variance grows with it. An even change cancels; a clipped pixel is infinitely different.
fn curvature(white: &Image, [early, late]: &[Image; 2], i: usize) -> f32 {
    (i * white.channels..(i + 1) * white.channels)
        .map(|j| {
            let (own, early, late) = (white.data[j], early.data[j], late.data[j]);
            let clipped = own.max(early).max(late) >= 1.0;
            if clipped { f32::INFINITY } else { (0.5 * (early + late) - own).powi(2) / own.max(MIN_LIGHT) }
        })
        .fold(0.0, f32::max)
}

/// Returns the means over small squares: brightness changes evenly over the image, but for noise.
fn smoothed(mut image: Image) -> Image {
    let channels = image.channels;
    let mut planes: Vec<Vec<f32>> =
        (0..channels).map(|c| image.data.iter().skip(c).step_by(channels).copied().collect()).collect();
    planes.par_iter_mut().for_each(|plane| box_mean(plane, image.width, image.height, TREND_RADIUS));
    for (i, px) in image.data.chunks_exact_mut(channels).enumerate() {
        px.iter_mut().zip(&planes).for_each(|(v, plane)| *v = plane[i]);
    }
    image
}
