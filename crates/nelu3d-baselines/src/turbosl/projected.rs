//! The projected images, and what the projector's blur makes of them.
//!
//! An image that changes along one axis is kept as a line, which is blurred along that axis alone; any other is kept as
//! it is, and blurred along x and then along y. What is blurred is clipped to [0, 1].

use nelu3d::reconstruct::neural::checkpoint::SceneDigest;
use nelu3d_scan::pattern::{Axis, Stripes};
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::{Projector, Rig};
use rayon::prelude::*;

use super::blur::{self, Blur, HALF};
use crate::captured::Captured;
use crate::code::{FLAT, ProjectedLight, read_projected};
use crate::error::DecodeError;

/// The light of a projected image, or of one of its color channels, 0 to 1.
#[derive(Clone, Debug)]
pub enum Projected {
    /// It changes along one axis: its values along that.
    Line(Axis, Vec<f32>),
    /// It changes along both: its values, row by row.
    Image(Vec<f32>),
}

/// What the projector shows while each plane of the captures (an image, or one channel of one) is taken.
#[derive(Clone, Debug)]
pub struct ProjectedPlanes {
    /// Width and height, projector pixels.
    size: [usize; 2],
    planes: Vec<Projected>,
}

/// Gradients by the free taps of the blur along x and along y.
pub type BlurGradient = [[f32; 2 * HALF]; 2];

impl ProjectedPlanes {
    /// Reads the projected images of a set: one value per plane of the captures, gray images for all its channels.
    ///
    /// # Errors
    ///
    /// An image is missing, cannot be read, or has another size than the projector.
    pub(crate) fn read(
        rig: &Rig,
        set: &PatternSet,
        projector: &Projector,
        light: &ProjectedLight,
        captured: &Captured,
    ) -> Result<Self, DecodeError> {
        let size = [projector.optics.width, projector.optics.height];
        let images = read_projected(rig, set, Some(size))?;
        let plane = |p: &crate::captured::Plane| {
            let image = &images[p.image].1;
            let (w, c) = (size[0], image.channels);
            let value = |i: usize| light.of(image.data[i * c + p.channel.min(c - 1)]);
            match Stripes::of(image, FLAT) {
                Stripes::Along(Axis::Y) => Projected::Line(Axis::Y, (0..size[1]).map(|y| value(y * w)).collect()),
                Stripes::Along(Axis::X) | Stripes::Constant => Projected::Line(Axis::X, (0..w).map(value).collect()),
                Stripes::Both => Projected::Image((0..w * size[1]).map(value).collect()),
            }
        };
        Ok(Self { size, planes: captured.planes.iter().map(plane).collect() })
    }

    /// Makes planes of one size (width, height; projector pixels) from what they show: an image has as many values as
    /// pixels, a line as many as there are along its axis.
    pub fn new(size: [usize; 2], planes: Vec<Projected>) -> Self {
        Self { size, planes }
    }

    /// Adds what is shown to a digest.
    pub(super) fn digest(&self, digest: &mut SceneDigest) {
        for plane in &self.planes {
            match plane {
                Projected::Line(axis, values) => digest.text(&format!("{axis:?}")).floats(values),
                Projected::Image(values) => digest.text(&"image").floats(values),
            };
        }
    }

    /// Returns the number of planes.
    pub(crate) fn len(&self) -> usize {
        self.planes.len()
    }

    /// Returns the blurred planes, each laid out as the plane itself; `blur` is along x and along y.
    pub fn blurred(&self, blur: &[Blur; 2]) -> Vec<Vec<f32>> {
        let blurred = |plane: &Projected| {
            let mut out = match plane {
                Projected::Line(axis, line) => blur[*axis as usize].convolve(line),
                Projected::Image(image) => {
                    along_y(&along_x(image, self.size, &blur[0].taps()), self.size, &blur[1].taps())
                }
            };
            out.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
            out
        };
        self.planes.par_iter().map(blurred).collect()
    }

    /// Returns the value of blurred plane `j` at a place (x, y; projector pixels) between the projector's pixels,
    /// (bi)linear; 0 outside.
    #[inline]
    pub fn sample(&self, j: usize, blurred: &[f32], place: [f32; 2]) -> f32 {
        match &self.planes[j] {
            Projected::Line(axis, _) => blur::sample(blurred, place[*axis as usize]),
            Projected::Image(_) => self.corners(place).into_iter().flatten().map(|(i, w)| w * blurred[i]).sum(),
        }
    }

    /// Adds to `d_blurred` the gradient of [`Self::sample`] by the blurred plane, times `d`.
    pub fn sample_backward(&self, j: usize, d_blurred: &mut [f32], place: [f32; 2], d: f32) {
        match &self.planes[j] {
            Projected::Line(axis, _) => blur::sample_backward(d_blurred, place[*axis as usize], d),
            Projected::Image(_) => {
                self.corners(place).into_iter().flatten().for_each(|(i, w)| d_blurred[i] += w * d);
            }
        }
    }

    /// Returns where in blurred plane `j` the value of a projector pixel (of the whole image, row by row) lies.
    pub fn index(&self, j: usize, pixel: usize) -> usize {
        match &self.planes[j] {
            Projected::Line(axis, _) => [pixel % self.size[0], pixel / self.size[0]][*axis as usize],
            Projected::Image(_) => pixel,
        }
    }

    /// Returns the gradients by the free taps, given those by the blurred planes; summed in a fixed order.
    pub fn blur_backward(&self, blur: &[Blur; 2], d_blurred: &[Vec<f32>]) -> BlurGradient {
        let of_plane = |(plane, d): (&Projected, &Vec<f32>)| {
            let mut out = BlurGradient::default();
            match plane {
                Projected::Line(axis, line) => {
                    let d = inside(&blur[*axis as usize].convolve(line), d);
                    let taps = blur::tap_gradient(line, &d);
                    blur[*axis as usize].backward(&taps, &mut out[*axis as usize]);
                }
                Projected::Image(image) => self.image_backward(image, blur, d, &mut out),
            }
            out
        };
        let all: Vec<BlurGradient> = self.planes.par_iter().zip(d_blurred).map(of_plane).collect();
        let mut sum = BlurGradient::default();
        for of_plane in all {
            for (sum, d) in sum.as_flattened_mut().iter_mut().zip(of_plane.as_flattened()) {
                *sum += d;
            }
        }
        sum
    }

    /// Adds to `out` the gradients by the free taps of both axes that one pattern of two dimensions contributes.
    /// `image` is the pattern and `d` the gradient by its blurred plane, row by row.
    fn image_backward(&self, image: &[f32], blur: &[Blur; 2], d: &[f32], out: &mut BlurGradient) {
        let (size, taps) = (self.size, blur.each_ref().map(Blur::taps));
        let along = along_x(image, size, &taps[0]);
        let d = inside(&along_y(&along, size, &taps[1]), d);
        let mut reversed = taps[1];
        reversed.reverse();
        let d_along = along_y(&d, size, &reversed);
        let [w, h] = size;
        let mut d_taps = [[0.0; blur::TAPS]; 2];
        for t in 0..blur::TAPS {
            // A row of the image against the row, or the part of it, that the tap sees.
            let rows = |y: usize| Some((y, (y + t).checked_sub(HALF).filter(|from| *from < h)?));
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            d_taps[1][t] = (0..h)
                .filter_map(rows)
                .map(|(y, from)| dot(&d[y * w..(y + 1) * w], &along[from * w..(from + 1) * w]))
                .sum();
            let (left, right) = (HALF.saturating_sub(t), t.saturating_sub(HALF));
            d_taps[0][t] = (0..h)
                .map(|y| {
                    let (d, row) = (&d_along[y * w..(y + 1) * w], &image[y * w..(y + 1) * w]);
                    dot(&d[left.min(w)..w - right.min(w)], &row[right.min(w)..w - left.min(w)])
                })
                .sum();
        }
        blur[0].backward(&d_taps[0], &mut out[0]);
        blur[1].backward(&d_taps[1], &mut out[1]);
    }

    /// Returns the four pixels around a place, each with its weight; `None` outside of the image.
    fn corners(&self, [u, v]: [f32; 2]) -> [Option<(usize, f32)>; 4] {
        let [w, h] = self.size;
        let (x, y) = (u.floor(), v.floor());
        [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(dx, dy)| {
            let (px, py) = (x + dx, y + dy);
            let within = px >= 0.0 && py >= 0.0 && px < w as f32 && py < h as f32;
            within.then(|| (py as usize * w + px as usize, (1.0 - (u - px).abs()) * (1.0 - (v - py).abs())))
        })
    }
}

/// Returns the gradient by what is clipped to [0, 1] afterwards: none where that clips.
fn inside(convolved: &[f32], d: &[f32]) -> Vec<f32> {
    convolved.iter().zip(d).map(|(v, d)| if (0.0..=1.0).contains(v) { *d } else { 0.0 }).collect()
}

/// Convolves every row; there is no light beyond the image.
fn along_x(image: &[f32], [w, _]: [usize; 2], taps: &[f32; blur::TAPS]) -> Vec<f32> {
    let mut out = vec![0.0; image.len()];
    out.par_chunks_mut(w).zip(image.par_chunks(w)).for_each(|(out, row)| {
        for (t, tap) in taps.iter().enumerate().filter(|(_, tap)| **tap != 0.0) {
            let (left, right) = (HALF.saturating_sub(t).min(w), t.saturating_sub(HALF).min(w));
            out[left..w - right].iter_mut().zip(&row[right..w - left]).for_each(|(o, v)| *o += tap * v);
        }
    });
    out
}

/// Convolves every column; there is no light beyond the image.
fn along_y(image: &[f32], [w, h]: [usize; 2], taps: &[f32; blur::TAPS]) -> Vec<f32> {
    let mut out = vec![0.0; image.len()];
    out.par_chunks_mut(w).enumerate().for_each(|(y, out)| {
        for (t, tap) in taps.iter().enumerate().filter(|(_, tap)| **tap != 0.0) {
            if let Some(from) = (y + t).checked_sub(HALF).filter(|from| *from < h) {
                out.iter_mut().zip(&image[from * w..(from + 1) * w]).for_each(|(o, v)| *o += tap * v);
            }
        }
    });
    out
}
