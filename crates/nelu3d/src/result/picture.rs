//! Pictures of maps.

use colorous::Gradient;
use nelu3d_scan::Image;
use nelu3d_scan::image::encode_rgb8;
use nelu3d_scan::statistics::percentile;
use rayon::prelude::*;

use crate::surface::{PixelStatus, Surface};

/// The color of pixels without a value.
const EMPTY: [u8; 3] = [24, 26, 31];

/// The colors of depth: perceptually uniform, and readable without seeing red or green apart.
pub const DEPTH_COLORS: Gradient = colorous::VIRIDIS;

/// An 8-bit sRGB picture.
#[derive(Clone, Debug)]
pub struct Picture {
    width: usize,
    height: usize,
    /// Row by row.
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    /// Makes a picture from a function of the pixel's index, row by row.
    pub fn from_fn(width: usize, height: usize, color: impl Fn(usize) -> [u8; 3] + Sync) -> Self {
        Self { width, height, pixels: (0..width * height).into_par_iter().map(&color).collect() }
    }

    /// Draws a map in the colors of `gradient`, from `range[0]` to `range[1]`; values that are not finite stay dark.
    pub fn of_map(map: &[f32], width: usize, height: usize, range: [f64; 2], gradient: Gradient) -> Self {
        Self::from_fn(width, height, |i| map_color(map[i], range, gradient))
    }

    /// Draws normals as a clay surface lit from the upper left behind the camera, times a color per pixel.
    pub fn shaded(normals: &[[f32; 3]], width: usize, height: usize, color: impl Fn(usize) -> [u8; 3] + Sync) -> Self {
        Self::from_fn(width, height, |i| shaded(normals[i], || color(i)))
    }

    /// Draws a capture: linear light to sRGB, its 99.5th percentile as white.
    pub fn of_image(capture: &Image) -> Self {
        Self::from_fn(capture.width, capture.height, colors_of(capture))
    }

    /// Draws the status of pixels in the colors of [`status_color`].
    pub fn of_status(status: &[PixelStatus], width: usize, height: usize) -> Self {
        Self::from_fn(width, height, |i| status_color(status[i]))
    }

    /// Shrinks to at most `max_width` pixels across, averaging; never enlarged.
    pub fn at_most(self, max_width: usize) -> Self {
        if self.width <= max_width {
            return self;
        }
        let (width, height) = (max_width, (self.height * max_width / self.width).max(1));
        // The source rows or columns of each target row or column: at least one, none twice.
        let blocks = |from: usize, to: usize| -> Vec<std::ops::Range<usize>> {
            let ratio = from as f32 / to as f32;
            let block = |i: usize| {
                let first = i as f32 * ratio;
                let start = (first.ceil() as usize).min(from - 1);
                start..((first + ratio).ceil() as usize).clamp(start + 1, from)
            };
            (0..to).map(block).collect()
        };
        let (columns, rows) = (blocks(self.width, width), blocks(self.height, height));
        Self::from_fn(width, height, |i| {
            let (columns, rows) = (&columns[i % width], &rows[i / width]);
            let n = columns.len() * rows.len();
            let pixels = || rows.clone().flat_map(|y| &self.pixels[y * self.width..][columns.clone()]);
            [0, 1, 2].map(|c| ((pixels().map(|p| usize::from(p[c])).sum::<usize>() + n / 2) / n) as u8)
        })
    }

    /// Joins pictures of equal height side by side.
    ///
    /// # Panics
    ///
    /// If the heights differ, or there is no picture.
    pub fn beside(panels: &[Picture]) -> Self {
        let height = panels[0].height;
        assert!(panels.iter().all(|p| p.height == height), "panels of different heights");
        let row = |y: usize| panels.iter().flat_map(move |p| &p.pixels[y * p.width..(y + 1) * p.width]);
        Self {
            width: panels.iter().map(|p| p.width).sum(),
            height,
            pixels: (0..height).flat_map(row).copied().collect(),
        }
    }

    /// Returns width and height, pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Returns the color of a pixel by its index, row by row.
    pub fn rgb(&self, i: usize) -> [u8; 3] {
        self.pixels[i]
    }

    /// Encodes the picture as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        encode_rgb8(self.width, self.height, self.pixels.as_flattened())
    }
}

/// Returns the color of a map's value, clamped to `range`; dark where it is not finite.
pub fn map_color(value: f32, range: [f64; 2], gradient: Gradient) -> [u8; 3] {
    if value.is_finite() { color_at(gradient, f64::from(value), range) } else { EMPTY }
}

/// Returns the color of a value, clamped to `range`.
pub fn color_at(gradient: Gradient, value: f64, range: [f64; 2]) -> [u8; 3] {
    let t = (value - range[0]) / (range[1] - range[0]);
    let c = gradient.eval_continuous(if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.5 });
    [c.r, c.g, c.b]
}

/// Returns the color of a status in [`Picture::of_status`].
pub fn status_color(status: PixelStatus) -> [u8; 3] {
    match status {
        PixelStatus::Valid => [222, 226, 230],
        PixelStatus::OutsideVolume => [90, 97, 110],
        PixelStatus::Saturated => [230, 159, 0],
        PixelStatus::Underexposed => [24, 26, 31],
        PixelStatus::Ambiguous => [213, 94, 0],
        PixelStatus::DepthDiscontinuity => [0, 114, 178],
    }
}

/// Returns robust limits of a map, for its colors: the `low`-th and `high`-th percentile of its finite values; `[0, 1]`
/// when it has none.
pub fn limits(map: &[f32], low: f64, high: f64) -> [f64; 2] {
    let mut finite: Vec<f64> = map.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v)).collect();
    if finite.is_empty() {
        return [0.0, 1.0];
    }
    let [a, b] = [percentile(&mut finite, low), percentile(&mut finite, high)];
    if b > a { [a, b] } else { [a - 0.5, a + 0.5] }
}

/// Draws the preview of a result: the capture, the surface as clay, and the surface in the colors of its depth.
pub fn preview(r: &Surface) -> Picture {
    let range = limits(&r.depth, 1.0, 99.0);
    // Near is bright: depth seen from the camera.
    let depth_color = |i: usize| color_at(DEPTH_COLORS, range[0] + range[1] - f64::from(r.depth[i]), range);
    let [x, y, width, height] = surroundings(r);
    let panel = |color: &(dyn Fn(usize) -> [u8; 3] + Sync)| {
        Picture::from_fn(width, height, |i| color((y + i / width) * r.width + x + i % width)).at_most(640)
    };
    Picture::beside(&[
        panel(&colors_of(&r.white)),
        panel(&|i| shaded(r.normals[i], || [226, 221, 212])),
        panel(&|i| shaded(r.normals[i], || depth_color(i))),
    ])
}

/// Returns the sRGB color of a capture's pixels by their index: its 99.5th percentile is white.
pub(super) fn colors_of(capture: &Image) -> impl Fn(usize) -> [u8; 3] {
    let white = percentile(&mut capture.data.iter().step_by(7).map(|&v| f64::from(v)).collect::<Vec<_>>(), 99.5);
    let gain = if white > 0.0 { 1.0 / white as f32 } else { 1.0 };
    move |i| {
        let p = &capture.data[i * capture.channels..(i + 1) * capture.channels];
        let at = |c: usize| srgb(p[if capture.channels == 3 { c } else { 0 }] * gain);
        [at(0), at(1), at(2)]
    }
}

/// Returns a color on a surface with a normal, lit as clay is; dark where there is none.
fn shaded(normal: [f32; 3], color: impl Fn() -> [u8; 3]) -> [u8; 3] {
    match shade(normal) {
        Some(s) => color().map(|c| (f32::from(c) * s).min(255.0) as u8),
        None => EMPTY,
    }
}

/// Returns the rectangle `[x, y, width, height]` around the pixels that have depth, with a margin; the whole image when
/// there are none.
fn surroundings(r: &Surface) -> [usize; 4] {
    let valid = || (0..r.depth.len()).filter(|&i| r.depth[i].is_finite());
    let along = |coordinate: &dyn Fn(usize) -> usize, size: usize| -> [usize; 2] {
        let (Some(low), Some(high)) = (valid().map(coordinate).min(), valid().map(coordinate).max()) else {
            return [0, size];
        };
        let margin = 4 + (high - low) / 12;
        let start = low.saturating_sub(margin);
        [start, (high + margin + 1).min(size) - start]
    };
    let ([x, width], [y, height]) = (along(&|i| i % r.width, r.width), along(&|i| i / r.width, r.height));
    [x, y, width, height]
}

/// Returns the brightness of a clay surface: a key light over the left shoulder, a weak fill from the right, some
/// ambient.
fn shade(n: [f32; 3]) -> Option<f32> {
    const KEY: [f32; 3] = [-0.45, -0.55, -0.70];
    const FILL: [f32; 3] = [0.77, 0.10, -0.63];
    if !n[0].is_finite() {
        return None;
    }
    let dot = |l: [f32; 3]| (n[0] * l[0] + n[1] * l[1] + n[2] * l[2]).max(0.0);
    Some(0.16 + 0.80 * dot(KEY) + 0.22 * dot(FILL))
}

/// Applies the sRGB transfer function, IEC 61966-2-1.
fn srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let s = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round() as u8
}
