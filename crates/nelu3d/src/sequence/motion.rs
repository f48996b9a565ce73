//! Motion between a pattern and its white (flash) image.
//!
//! The white image of a frame is taken a part of the frame's duration before or after its pattern. Where something
//! moved in between, white belongs to other points of the surface than pattern does, and their ratio is no codeword.
//! Where every point of a white image was a frame earlier and will be a frame later follows from the neighboring
//! frames' white images; between them it moves with constant acceleration, and its brightness (shading, falloff)
//! changes evenly. So the white image can be drawn as it was at any time near its own, and that of the pattern is the
//! one at which pattern and white agree best with the surface. (The paper leaves this to future work, and names the
//! displacement fields of Urakawa and Watanabe.)

use nelu3d_scan::Image;
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::brightness::{Brightness, MIN_LIGHT, is_lit};
use super::flow::{flow, unexplained};
use super::pyramid::Pyramid;
use super::resample::cubic;
use super::vector_map::VectorMap;
use crate::reconstruct::{LitPart, interpolate_within};

/// Pixels whose depths differ by more than this fraction belong to different surfaces.
const JUMP: f32 = 0.01;

/// Largest fraction of an image's light that its neighbor may leave unexplained. For moving objects it is a few
/// hundredths (their outlines), for a cut a third and more.
const MAX_UNEXPLAINED: f32 = 0.12;

/// The motion of a white image's points between the neighboring frames, in the part of the image that is lit.
pub struct Motion {
    /// The part that is lit in any of the white images.
    #[doc(hidden)]
    pub part: LitPart,
    /// Velocity along x and y, px per frame, and acceleration, px per frame², over that part.
    #[doc(hidden)]
    pub motion: VectorMap<4>,
    /// Brightness of that part's points over time; `None` without two neighbors.
    #[doc(hidden)]
    pub brightness: Option<Brightness>,
}

impl Motion {
    /// Estimates motion from the white image of a frame and those of the frames before and after it. A neighbor that
    /// shows something else (a cut, an object that enters or leaves) counts as none; `None` without either.
    pub fn around(before: Option<&Image>, white: &Image, after: Option<&Image>) -> Option<Self> {
        let all = [before, Some(white), after];
        let width = white.width;
        let is_lit =
            |i: usize| all.iter().flatten().any(|image| is_lit(image.pixel(i % width, i / width), 0.5 * MIN_LIGHT));
        let part = LitPart::around(width, white.height, is_lit);
        let [before, white, after] = all.map(|image| image.map(|image| part.of_image(image)));
        let white = white?;
        let here = stabilized(&white);
        let to = |other: Option<&Image>| {
            let there = stabilized(other?);
            let u = flow(&here, &there);
            (unexplained(&here, &there, &u) <= MAX_UNEXPLAINED).then_some(u)
        };
        let (back, forth) = rayon::join(|| to(before.as_ref()), || to(after.as_ref()));
        // A missing neighbor shows what constant velocity would: the other one's motion, turned round.
        let opposite = |u: &VectorMap<2>| {
            let values = u.values.iter().map(|u| u.map(|v| -v)).collect();
            VectorMap { values, ..u.clone() }
        };
        let both = back.is_some() && forth.is_some();
        let (back, forth) = match (back, forth) {
            (Some(b), Some(f)) => (b, f),
            (Some(b), None) => (b.clone(), opposite(&b)),
            (None, Some(f)) => (opposite(&f), f),
            (None, None) => return None,
        };
        let one = |(b, f): (&[f32; 2], &[f32; 2])| [0.5 * (f[0] - b[0]), 0.5 * (f[1] - b[1]), f[0] + b[0], f[1] + b[1]];
        let values = back.values.iter().zip(&forth.values).map(one).collect();
        let motion = VectorMap { size: back.size, spacing: back.spacing, values };
        let brightness = match (&before, &after) {
            (Some(before), Some(after)) if both => Some(Brightness::estimate(&white, [before, after], [&back, &forth])),
            _ => None,
        };
        Some(Self { part, motion, brightness })
    }

    /// Returns whether the change of brightness is known, however little the points move.
    pub fn has_brightness(&self) -> bool {
        self.brightness.is_some()
    }

    /// Returns the median speed where a pixel of the white image is `lit`, px per frame; 0 if there is none.
    pub fn median_px(&self, lit: impl Fn(usize) -> bool) -> f32 {
        let ([x0, y0], width) = (self.part.origin, self.part.image[0]);
        let [w, h] = self.part.size;
        let is_lit = |i: &usize| {
            let [x, y] = self.motion.place(*i).map(|v| v.round().max(0.0) as usize);
            lit((y0 + y.min(h - 1)) * width + x0 + x.min(w - 1))
        };
        let values = &self.motion.values;
        let mut speed: Vec<f32> = (0..values.len()).filter(is_lit).map(|i| values[i][0].hypot(values[i][1])).collect();
        median(&mut speed).unwrap_or(0.0)
    }

    /// Returns the pixel of the lit part that shows the point that is at its pixel (x, y) `t` frames after the white
    /// image (before it, if negative).
    fn source(&self, x: f32, y: f32, t: f32) -> [f32; 2] {
        let mut p = [x, y];
        // p + displacement(p, t) = (x, y), solved for p; motion changes slowly over the image, so this converges at
        // once.
        for _ in 0..3 {
            let [vx, vy, ax, ay] = self.motion.at(p);
            p = [x - t * (vx + 0.5 * t * ax), y - t * (vy + 0.5 * t * ay)];
        }
        p
    }

    /// Returns the previous frame's surface where its points are in this frame: camera z per pixel, mm, as it was then;
    /// NaN where there was none. Both frames' patterns were taken `t` frames after their white images.
    ///
    /// # Panics
    ///
    /// If the map has another size than the white image.
    pub fn warp_depth(&self, previous: &[f32], t: f32) -> Vec<f32> {
        let [w, h] = self.part.image;
        assert_eq!(previous.len(), w * h, "a map of the white image's size");
        let (origin, width) = (self.part.origin, self.part.size[0]);
        let one = |i: usize| {
            let [x, y] = [(i % width) as f32, (i / width) as f32];
            let [vx, vy, ax, ay] = self.motion.at(self.source(x, y, t));
            // From time t to t − 1.
            let back = [0.5 * (1.0 - 2.0 * t) * ax - vx, 0.5 * (1.0 - 2.0 * t) * ay - vy];
            let (x, y) = (x + back[0] + origin[0] as f32, y + back[1] + origin[1] as f32);
            if !(x >= 0.0 && y >= 0.0 && x <= w as f32 - 1.0 && y <= h as f32 - 1.0) {
                return f32::NAN;
            }
            let near = previous[y.round() as usize * w + x.round() as usize];
            interpolate_within(previous, w, h, x, y, JUMP * near)
        };
        let n = width * self.part.size[1];
        self.part.paste((0..n).into_par_iter().with_min_len(width).map(one).collect(), f32::NAN)
    }

    /// Returns the white image as it would have been `t` frames after its own time.
    pub fn white_at(&self, white: &Image, t: f32) -> Image {
        let mut out = white.clone();
        let ([x0, y0], [w, h], channels) = (self.part.origin, self.part.size, white.channels);
        let rows = out.data.par_chunks_mut(white.width * channels).enumerate().skip(y0).take(h);
        rows.for_each(|(y, row)| {
            for (x, px) in row.chunks_exact_mut(channels).enumerate().skip(x0).take(w) {
                self.white_pixel_at(white, x, y, t, px);
            }
        });
        out
    }

    /// Draws pixel (x, y) of [`Self::white_at`] into `out`, one value per channel.
    pub(super) fn white_pixel_at(&self, white: &Image, x: usize, y: usize, t: f32, out: &mut [f32]) {
        let ([x0, y0], [w, h]) = (self.part.origin.map(|v| v as f32), self.part.size);
        let p = self.source(x as f32 - x0, y as f32 - y0, t);
        let Some(brightness) = &self.brightness else { return cubic(white, [p[0] + x0, p[1] + y0], out) };
        cubic(&brightness.now, p, out);
        let nearest = |v: f32, n: usize| v.round().clamp(0.0, n as f32 - 1.0) as usize;
        let trend = brightness.trend.pixel(nearest(p[0], w), nearest(p[1], h));
        for (out, trend) in out.iter_mut().zip(trend) {
            // What is clipped stays so, and nothing else becomes it.
            if *out < 1.0 {
                *out = (*out + t * trend).min(1.0 - f32::EPSILON);
            }
        }
    }
}

/// Returns the square root of an image's channels: the shot noise of the square root of light does not depend on
/// brightness.
fn stabilized(image: &Image) -> Pyramid {
    let channel = |c: usize| image.data.iter().skip(c).step_by(image.channels).map(|v| v.max(0.0).sqrt()).collect();
    Pyramid::new((0..image.channels).map(channel).collect(), image.width, image.height)
}
