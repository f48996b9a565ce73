//! The part of an image that is lit: the rest costs time and memory, and can have no depth.

use std::borrow::Cow;

use nelu3d_scan::rig::Capture;
use nelu3d_scan::{Camera, Image};
use rayon::prelude::*;

use crate::sensor::{DarkLevel, NoiseModel};
use crate::surface::{PixelStatus, Surface};

/// Side of the squares of pixels in which light is looked for, px.
const SQUARE: usize = 16;
/// Lit pixels from which a square counts: a hot pixel does not.
const MIN_LIT: usize = 4;
/// Dark pixels around what is lit, px: outlines are looked at from both sides.
const MARGIN: usize = 16;
/// Fraction of the image below which leaving the rest out is worth a copy.
const WORTH_IT: f64 = 0.8;

/// A rectangle of an image's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LitPart {
    /// First column and row of the rectangle in the image, px.
    pub origin: [usize; 2],
    /// Width and height of the rectangle, px.
    pub size: [usize; 2],
    /// Width and height of the image, px.
    pub image: [usize; 2],
}

impl LitPart {
    /// All of an image.
    pub(crate) fn whole(width: usize, height: usize) -> Self {
        let image = [width, height];
        Self { origin: [0, 0], size: image, image }
    }

    /// Returns the part of a capture outside of which every pixel is underexposed, but for single ones. It is the whole
    /// image where nothing is lit, or nearly all.
    pub fn of(capture: &Capture, noise: &NoiseModel, dark: &[DarkLevel]) -> Self {
        let white = &capture.white;
        let channels = (capture.patterns.len() * white.channels) as f32;
        Self::around(white.width, white.height, |i: usize| {
            (0..white.channels).any(|c| {
                let w = white.data[i * white.channels + c];
                let black = match &capture.black {
                    Some(black) => black.data[i * white.channels + c],
                    None => dark.get(c).map_or(0.0, |d| d.at(w)),
                };
                w >= 1.0 || (w > black && !noise.is_underexposed(w - black, black, channels))
            })
        })
    }

    /// Returns the part of an image outside of which no pixel is lit, but for single ones. It is the whole image where
    /// nothing is lit, or nearly all.
    pub(crate) fn around(width: usize, height: usize, is_lit: impl Fn(usize) -> bool + Sync) -> Self {
        let whole = Self::whole(width, height);
        let [w, h] = whole.image;
        // The first and the last column and row of the squares that count.
        let of_row = |y: usize| {
            let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
            for x in (0..w).step_by(SQUARE) {
                let end = [(x + SQUARE).min(w), (y + SQUARE).min(h)];
                let pixels = (y..end[1]).flat_map(|row| (x..end[0]).map(move |column| row * w + column));
                if pixels.filter(|i| is_lit(*i)).take(MIN_LIT).count() == MIN_LIT {
                    low = [low[0].min(x), y];
                    high = end;
                }
            }
            (low, high)
        };
        let (low, high) = (0..h.div_ceil(SQUARE)).into_par_iter().map(|row| of_row(row * SQUARE)).reduce(
            || ([usize::MAX; 2], [0; 2]),
            |(a, b), (c, d)| (std::array::from_fn(|k| a[k].min(c[k])), std::array::from_fn(|k| b[k].max(d[k]))),
        );
        if low[0] == usize::MAX {
            return whole;
        }
        let origin = low.map(|v| v.saturating_sub(MARGIN));
        let size = std::array::from_fn(|a| (high[a] + MARGIN).min(whole.image[a]) - origin[a]);
        let part = Self { origin, size, image: whole.image };
        if part.n() as f64 > WORTH_IT * (w * h) as f64 { whole } else { part }
    }

    /// Returns the number of its pixels.
    fn n(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Returns whether this part is the whole picture.
    pub fn is_whole(&self) -> bool {
        self.size == self.image
    }

    /// Returns this part of a camera's picture, as a camera's.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let [x, y] = self.origin.map(|v| v as f64);
        let [width, height] = self.size;
        Camera { width, height, cx: camera.cx - x, cy: camera.cy - y, ..camera.clone() }
    }

    /// Returns this part of a capture and, unless it is all of it, the white image of the whole.
    pub fn of_capture<'a>(&self, capture: Cow<'a, Capture>) -> (Cow<'a, Capture>, Option<Cow<'a, Image>>) {
        if self.is_whole() {
            return (capture, None);
        }
        let part = Capture {
            white: self.of_image(&capture.white),
            black: capture.black.as_ref().map(|black| self.of_image(black)),
            patterns: capture.patterns.iter().map(|pattern| self.of_image(pattern)).collect(),
            mono: capture.mono.clone(),
        };
        (Cow::Owned(part), Some(white_of(capture)))
    }

    /// Returns this part of an image.
    pub(crate) fn of_image(&self, image: &Image) -> Image {
        let ([width, height], channels) = (self.size, image.channels);
        Image { width, height, channels, data: self.cut(&image.data, channels) }
    }

    /// Returns this part of a map of the image with `each` values per pixel.
    pub(crate) fn cut<T: Copy>(&self, map: &[T], each: usize) -> Vec<T> {
        let [x, y] = self.origin;
        let rows = (y..y + self.size[1]).map(|row| (row * self.image[0] + x) * each);
        rows.flat_map(|start| &map[start..start + self.size[0] * each]).copied().collect()
    }

    /// Returns a map of the image from one of this part, with `outside` everywhere else.
    pub fn paste<T: Copy>(&self, part: Vec<T>, outside: T) -> Vec<T> {
        if self.is_whole() {
            return part;
        }
        let mut map = vec![outside; self.image[0] * self.image[1]];
        for (row, values) in part.chunks_exact(self.size[0]).enumerate() {
            let start = (self.origin[1] + row) * self.image[0] + self.origin[0];
            map[start..start + self.size[0]].copy_from_slice(values);
        }
        map
    }

    /// Returns the surface of the image from that of this part; the rest of it is underexposed. `white` is the image's.
    pub(crate) fn surface(&self, part: Surface, white: Image) -> Surface {
        let Surface { depth, normals, sigma, status, residual, ambient, mesh, .. } = part;
        Surface {
            width: self.image[0],
            height: self.image[1],
            depth: self.paste(depth, f32::NAN),
            normals: self.paste(normals, [f32::NAN; 3]),
            sigma: self.paste(sigma, f32::NAN),
            status: self.paste(status, PixelStatus::Underexposed),
            residual: self.paste(residual, f32::NAN),
            ambient: self.paste(ambient, f32::NAN),
            white,
            mesh,
        }
    }
}

/// Returns the white image of a capture, without the rest.
pub(crate) fn white_of(capture: Cow<'_, Capture>) -> Cow<'_, Image> {
    match capture {
        Cow::Borrowed(capture) => Cow::Borrowed(&capture.white),
        Cow::Owned(capture) => Cow::Owned(capture.white),
    }
}
