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
use nelu3d_scan::image::bilinear;
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::brightness::Brightness;
use super::flow::{flow, warped_position};
use super::resample::cubic;
use crate::reconstruct::interpolate_within;

/// Pixels whose depths differ by more than this fraction belong to different surfaces.
const JUMP: f32 = 0.01;

/// Largest fraction of an image's light that its neighbor may leave unexplained. For moving objects it is a few
/// hundredths (their outlines), for a cut a third and more.
const MAX_UNEXPLAINED: f32 = 0.12;

/// The motion of a white image's points between the neighboring frames.
pub struct Motion {
    width: usize,
    height: usize,
    /// Velocity along x and y, per pixel, px per frame.
    velocity: [Vec<f32>; 2],
    /// Acceleration along x and y, per pixel, px per frame².
    acceleration: [Vec<f32>; 2],
    /// Brightness of the points over time; `None` without two neighbors.
    brightness: Option<Brightness>,
}

impl Motion {
    /// Estimates motion from the white image of a frame and those of the frames before and after it. A neighbor that
    /// shows something else (a cut, an object that enters or leaves) counts as none; `None` without either.
    pub fn around(before: Option<&Image>, white: &Image, after: Option<&Image>) -> Option<Self> {
        let (width, height) = (white.width, white.height);
        let here = stabilized(white);
        let to = |other: Option<&Image>| {
            let there = stabilized(other?);
            let u = flow(&here, &there, width, height);
            (unexplained(&here, &there, &u, [width, height]) <= MAX_UNEXPLAINED).then_some(u)
        };
        let (back, forth) = rayon::join(|| to(before), || to(after));
        // A missing neighbor shows what constant velocity would: the other one's motion, turned round.
        let opposite = |u: &[[f32; 2]]| u.iter().map(|u| u.map(|v| -v)).collect();
        let both = back.is_some() && forth.is_some();
        let (back, forth) = match (back, forth) {
            (Some(b), Some(f)) => (b, f),
            (Some(b), None) => (b.clone(), opposite(&b)),
            (None, Some(f)) => (opposite(&f), f),
            (None, None) => return None,
        };
        let each = |of: fn(f32, f32) -> f32| {
            [0, 1].map(|c| back.iter().zip(&forth).map(|(b, f)| of(b[c], f[c])).collect::<Vec<f32>>())
        };
        let (velocity, acceleration) = (each(|b, f| 0.5 * (f - b)), each(|b, f| f + b));
        let brightness = match (before, after) {
            (Some(before), Some(after)) if both => Some(Brightness::estimate(white, [before, after], [&back, &forth])),
            _ => None,
        };
        Some(Self { width, height, velocity, acceleration, brightness })
    }

    /// Returns whether the change of brightness is known, however little the points move.
    pub fn has_brightness(&self) -> bool {
        self.brightness.is_some()
    }

    /// Returns the median speed of the pixels where `lit`, px per frame; 0 if there are none.
    pub fn median_px(&self, lit: impl Fn(usize) -> bool) -> f32 {
        let [vx, vy] = &self.velocity;
        let mut speed: Vec<f32> = (0..vx.len()).filter(|i| lit(*i)).map(|i| vx[i].hypot(vy[i])).collect();
        median(&mut speed).unwrap_or(0.0)
    }

    /// Returns the pixel of the white image that shows the point that is at pixel (x, y) `t` frames after it (before
    /// it, if negative).
    fn source(&self, x: f32, y: f32, t: f32) -> [f32; 2] {
        let mut p = [x, y];
        // p + displacement(p, t) = (x, y), solved for p; motion changes slowly over the image, so this converges at
        // once.
        for _ in 0..3 {
            let d = [0, 1].map(|c| {
                let [velocity, acceleration] = self.at(p, c);
                t * velocity + 0.5 * t * t * acceleration
            });
            p = [x - d[0], y - d[1]];
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
        let (w, h) = (self.width, self.height);
        assert_eq!(previous.len(), w * h, "a map of the white image's size");
        (0..w * h)
            .into_par_iter()
            .with_min_len(w)
            .map(|i| {
                let (x, y) = ((i % w) as f32, (i / w) as f32);
                let source = self.source(x, y, t);
                // From time t to t − 1.
                let back = |c: usize| {
                    let [velocity, acceleration] = self.at(source, c);
                    0.5 * (1.0 - 2.0 * t) * acceleration - velocity
                };
                let (x, y) = (x + back(0), y + back(1));
                if !(x >= 0.0 && y >= 0.0 && x <= w as f32 - 1.0 && y <= h as f32 - 1.0) {
                    return f32::NAN;
                }
                let near = previous[y.round() as usize * w + x.round() as usize];
                interpolate_within(previous, w, h, x, y, JUMP * near)
            })
            .collect()
    }

    /// Returns velocity and acceleration of the point at `p` in the white image, along x (0) or y (1).
    fn at(&self, p: [f32; 2], c: usize) -> [f32; 2] {
        let size = [self.width, self.height];
        [&self.velocity, &self.acceleration].map(|map| bilinear(&map[c], size, p.map(f64::from)))
    }

    /// Returns the white image as it would have been `t` frames after its own time.
    pub fn white_at(&self, white: &Image, t: f32) -> Image {
        let mut out = Image::new(self.width, self.height, white.channels);
        out.data.par_chunks_mut(self.width * white.channels).enumerate().for_each(|(y, row)| {
            for (x, px) in row.chunks_exact_mut(white.channels).enumerate() {
                self.white_pixel_at(white, x as f32, y as f32, t, px);
            }
        });
        out
    }

    /// Draws one pixel of [`Self::white_at`] into `out`, one value per channel.
    pub(super) fn white_pixel_at(&self, white: &Image, x: f32, y: f32, t: f32, out: &mut [f32]) {
        let p = self.source(x, y, t);
        let Some(brightness) = &self.brightness else { return cubic(white, p, out) };
        cubic(&brightness.now, p, out);
        let at = p[0].round().clamp(0.0, self.width as f32 - 1.0) as usize
            + self.width * p[1].round().clamp(0.0, self.height as f32 - 1.0) as usize;
        let trend = &brightness.trend.data[at * out.len()..][..out.len()];
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
fn stabilized(image: &Image) -> Vec<Vec<f32>> {
    let channel = |c: usize| image.data.iter().skip(c).step_by(image.channels).map(|v| v.max(0.0).sqrt()).collect();
    (0..image.channels).map(channel).collect()
}

/// Returns the fraction of the light of image `a` that image `b`, warped by `u`, differs from: Σ |a² − b²| / Σ a² over
/// the channels and pixels of square roots.
fn unexplained(a: &[Vec<f32>], b: &[Vec<f32>], u: &[[f32; 2]], [w, h]: [usize; 2]) -> f32 {
    let sums = a.iter().zip(b).map(|(a, b)| {
        let warped = |i: usize| bilinear(b, [w, h], warped_position(i, w, u[i]));
        let one = |i: usize| f64::from((a[i] * a[i] - warped(i).powi(2)).abs());
        [(0..w * h).map(one).sum::<f64>(), a.iter().map(|v| f64::from(v * v)).sum::<f64>()]
    });
    let [difference, all] = sums.fold([0.0, 0.0], |s, v| [s[0] + v[0], s[1] + v[1]]);
    tracing::debug!(unexplained = difference / all, "motion");
    if all > 0.0 { (difference / all) as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(shift: f32) -> Image {
        let (width, height) = (160, 120);
        let mut image = Image::new(width, height, 1);
        for i in 0..width * height {
            let (x, y) = ((i % width) as f32 - shift, (i / width) as f32);
            image.data[i] = 0.3 + 0.1 * (0.2 * x + 0.1 * y).sin() + 0.08 * (0.17 * y - 0.1 * x).cos();
        }
        image
    }

    /// Under constant acceleration the white image is drawn as it was between frames.
    #[test]
    fn a_white_image_is_drawn_at_another_time() {
        let position = |t: f32| 3.0 * t + 0.8 * t * t;
        let motion =
            Motion::around(Some(&picture(position(-1.0))), &picture(0.0), Some(&picture(position(1.0)))).unwrap();
        for t in [-0.7, -0.25, 0.5] {
            let (drawn, expected) = (motion.white_at(&picture(0.0), t), picture(position(t)));
            let mut worst = 0.0f32;
            for i in
                (0..expected.data.len()).filter(|i| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160)))
            {
                worst = worst.max((drawn.data[i] - expected.data[i]).abs());
            }
            assert!(worst < 0.006, "{t}: {worst}");
        }
        assert!((motion.median_px(|_| true) - 3.0).abs() < 0.2);
    }

    /// Brightness that changes evenly along the way is drawn as it was; what only one white image shows is neither
    /// mixed in nor followed. Three white images have less noise than one.
    #[test]
    fn light_changes_along_the_way() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, Normal};
        let mut random = rand::rngs::StdRng::seed_from_u64(4);
        let noise = Normal::new(0.0, 0.003f32).unwrap();
        let expected = |t: f32| {
            let mut image = picture(2.0 * t);
            image.data.iter_mut().for_each(|v| *v *= 1.0 + 0.06 * t);
            image
        };
        let mut taken = |t: f32| {
            let mut image = expected(t);
            image.data.iter_mut().for_each(|v| *v += noise.sample(&mut random));
            image
        };
        let (before, white, mut after) = (taken(-1.0), taken(0.0), taken(1.0));
        // Something passes before the camera.
        let covered = |i: usize| (60..90).contains(&(i % 160)) && (40..70).contains(&(i / 160));
        (0..after.data.len()).filter(|i| covered(*i)).for_each(|i| after.data[i] = 0.9);
        let motion = Motion::around(Some(&before), &white, Some(&after)).unwrap();
        let alone = Motion { brightness: None, ..Motion::around(Some(&before), &white, Some(&after)).unwrap() };
        for t in [-0.5, 0.0, 0.3] {
            let expected = expected(t).data;
            let rms = |drawn: &Image, of: &dyn Fn(usize) -> bool| {
                let inner = |i: &usize| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160));
                let all: Vec<f32> = (0..drawn.data.len())
                    .filter(|i| inner(i) && of(*i))
                    .map(|i| (drawn.data[i] - expected[i]).powi(2))
                    .collect();
                (all.iter().sum::<f32>() / all.len() as f32).sqrt()
            };
            let far = |i: usize| !((45..105).contains(&(i % 160)) && (25..85).contains(&(i / 160)));
            let (with, without) = (motion.white_at(&white, t), alone.white_at(&white, t));
            let (a, b) = (rms(&with, &far), rms(&without, &far));
            assert!(a < 0.8 * b && a < 0.003, "{t}: {a}, of one white image {b}");
            let hidden = |i: usize| (66..84).contains(&(i % 160)) && (46..64).contains(&(i / 160));
            let (a, b) = (rms(&with, &hidden), rms(&without, &hidden));
            assert!(a < 1.3 * b + 0.002, "{t}: {a} where one white image shows something else, of one white image {b}");
        }
    }

    /// A surface with a texture on it moves along with the texture.
    #[test]
    fn a_surface_is_warped_to_the_next_frame() {
        let position = |t: f32| 3.0 * t + 0.5 * t * t;
        let motion =
            Motion::around(Some(&picture(position(-1.0))), &picture(0.0), Some(&picture(position(1.0)))).unwrap();
        let t = -0.3;
        let surface =
            |shift: f32| -> Vec<f32> { (0..160 * 120).map(|i| 500.0 + 0.2 * ((i % 160) as f32 - shift)).collect() };
        let (warped, expected) = (motion.warp_depth(&surface(position(t - 1.0)), t), surface(position(t)));
        for i in (0..expected.len()).filter(|i| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160))) {
            assert!((warped[i] - expected[i]).abs() < 0.05, "{i}: {} {}", warped[i], expected[i]);
        }
    }

    #[test]
    fn one_neighbor_gives_the_velocity_and_none_nothing() {
        let back = Motion::around(Some(&picture(-2.0)), &picture(0.0), None).unwrap();
        let forth = Motion::around(None, &picture(0.0), Some(&picture(2.0))).unwrap();
        let middle = 60 * 160 + 80;
        for m in [back, forth] {
            assert!((m.velocity[0][middle] - 2.0).abs() < 0.1, "{:?}", m.velocity[0][middle]);
        }
        assert!(Motion::around(None, &picture(0.0), None).is_none());
    }

    /// A neighbor that shows something else gives no motion.
    #[test]
    fn a_cut_is_no_motion() {
        let mut other = Image::new(160, 120, 1);
        for i in 0..160 * 120 {
            let (x, y) = ((i % 160) as f32, (i / 160) as f32);
            other.data[i] = if (x - 60.0).hypot(y - 70.0) < 40.0 { 0.7 } else { 0.01 };
        }
        assert!(Motion::around(Some(&other), &picture(0.0), None).is_none());
        let one = Motion::around(Some(&other), &picture(0.0), Some(&picture(2.0))).unwrap();
        assert!((one.velocity[0][60 * 160 + 80] - 2.0).abs() < 0.1);
    }

    #[test]
    fn what_is_clipped_stays_clipped() {
        let mut white = picture(0.0);
        white.data[50 * 160 + 70] = 1.0;
        let motion = Motion::around(None, &white, Some(&picture(1.0))).unwrap();
        let drawn = motion.white_at(&white, 0.5);
        assert!(drawn.data.iter().any(|v| *v >= 1.0));
    }
}
