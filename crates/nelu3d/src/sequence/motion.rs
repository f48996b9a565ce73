//! Motion between a pattern and its flash.
//!
//! The flash of a frame is taken a part of the frame's duration before or after its pattern. On what moved in between, white belongs
//! to other points of the surface than pattern does, and their ratio is no codeword. Where every point of a flash image was a frame
//! earlier and will be a frame later is seen in the neighboring frames' flashes; between them it moves with constant
//! acceleration, and its brightness (shading, falloff) changes evenly. So the flash can be drawn as it was at any time near its own, and that of the pattern is the one at which pattern
//! and flash agree best with the surface. (The paper leaves this to future work, and names the displacement fields of Urakawa and Watanabe.)

use nelu3d_scan::Image;
use nelu3d_scan::rig::Capture;
use rayon::prelude::*;

use super::flow::{bilinear, flow};
use crate::color_field::ColorField;
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::reconstruct::interpolate_within;
use crate::sensor::DarkLevel;
use nelu3d_scan::image::box_mean;

/// How the points of a flash image move.
pub struct Motion {
    width: usize,
    height: usize,
    /// Along x and y, per pixel, px per frame.
    velocity: [Vec<f32>; 2],
    /// The same, px per frame².
    acceleration: [Vec<f32>; 2],
    /// Of each point of the flash, with its light in three flashes; `None` without two neighbors.
    light: Option<Light>,
}

/// How the light of a flash image's points changes.
struct Light {
    /// At the flash's own time, with less noise.
    now: Image,
    /// Change per frame.
    trend: Image,
}

impl Motion {
    /// From the flash of a frame and those of the frames before and after it. A neighbor that shows something else (a cut, an object that
    /// enters or leaves) counts as none; `None` without either.
    pub fn around(before: Option<&Image>, white: &Image, after: Option<&Image>) -> Option<Self> {
        let (width, height) = (white.width, white.height);
        // Shot noise of the square root of light does not depend on brightness.
        let evened = |image: &Image| -> Vec<Vec<f32>> {
            let channel =
                |c: usize| image.data.iter().skip(c).step_by(image.channels).map(|v| v.max(0.0).sqrt()).collect();
            (0..image.channels).map(channel).collect()
        };
        let here = evened(white);
        let to = |other: Option<&Image>| {
            let there = evened(other?);
            let u = flow(&here, &there, width, height);
            (unexplained(&here, &there, &u, [width, height]) <= MOST_UNEXPLAINED).then_some(u)
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
        let light = match (before, after) {
            (Some(before), Some(after)) if both => Some(Light::along(white, [before, after], [&back, &forth])),
            _ => None,
        };
        Some(Self { width, height, velocity, acceleration, light })
    }

    /// Whether it knows how the light of points changes, however little they move.
    pub fn tells_light(&self) -> bool {
        self.light.is_some()
    }

    /// Median speed of the pixels where `lit`, px per frame.
    pub fn median_px(&self, lit: impl Fn(usize) -> bool) -> f32 {
        let [vx, vy] = &self.velocity;
        let mut speed: Vec<f32> = (0..vx.len()).filter(|i| lit(*i)).map(|i| vx[i].hypot(vy[i])).collect();
        if speed.is_empty() {
            return 0.0;
        }
        let mid = speed.len() / 2;
        *speed.select_nth_unstable_by(mid, f32::total_cmp).1
    }

    /// Where in the flash the point is that was at pixel (x, y) `t` frames after it (before it, if negative).
    fn source(&self, x: f32, y: f32, t: f32) -> [f32; 2] {
        let mut p = [x, y];
        // p + displacement(p, t) = (x, y), solved for p; motion changes slowly over the image, so this converges at once.
        for _ in 0..3 {
            let d = [0, 1].map(|c| {
                let [velocity, acceleration] = self.at(p, c);
                t * velocity + 0.5 * t * t * acceleration
            });
            p = [x - d[0], y - d[1]];
        }
        p
    }

    /// The surface of the frame before, where its points are in this frame: camera z per pixel as it was then, NaN where there was none.
    /// Both frames' patterns were taken `t` frames after their flashes.
    pub fn carried(&self, before: &[f32], t: f32) -> Vec<f32> {
        let (w, h) = (self.width, self.height);
        assert_eq!(before.len(), w * h, "a map of the flash's size");
        (0..w * h)
            .into_par_iter()
            .with_min_len(w)
            .map(|i| {
                let (x, y) = ((i % w) as f32, (i / w) as f32);
                let flash = self.source(x, y, t);
                // From time t to t − 1.
                let back = |c: usize| {
                    let [velocity, acceleration] = self.at(flash, c);
                    0.5 * (1.0 - 2.0 * t) * acceleration - velocity
                };
                let (x, y) = (x + back(0), y + back(1));
                if !(x >= 0.0 && y >= 0.0 && x <= w as f32 - 1.0 && y <= h as f32 - 1.0) {
                    return f32::NAN;
                }
                let near = before[y.round() as usize * w + x.round() as usize];
                interpolate_within(before, w, h, x, y, JUMP * near)
            })
            .collect()
    }

    /// Velocity and acceleration of the point at `p` in the flash, along x (0) or y (1).
    fn at(&self, p: [f32; 2], c: usize) -> [f32; 2] {
        [&self.velocity, &self.acceleration].map(|map| bilinear(&map[c], [self.width, self.height], p[0], p[1]))
    }

    /// The flash as it would have been `t` frames after its own time.
    pub fn flash_at(&self, white: &Image, t: f32) -> Image {
        let mut out = Image::new(self.width, self.height, white.channels);
        out.data.par_chunks_mut(self.width * white.channels).enumerate().for_each(|(y, row)| {
            for (x, px) in row.chunks_exact_mut(white.channels).enumerate() {
                self.light_at(white, x as f32, y as f32, t, px);
            }
        });
        out
    }

    /// A pixel of it.
    fn light_at(&self, white: &Image, x: f32, y: f32, t: f32, out: &mut [f32]) {
        let p = self.source(x, y, t);
        let Some(light) = &self.light else { return cubic(white, p, out) };
        cubic(&light.now, p, out);
        let at = p[0].round().clamp(0.0, self.width as f32 - 1.0) as usize
            + self.width * p[1].round().clamp(0.0, self.height as f32 - 1.0) as usize;
        let trend = &light.trend.data[at * out.len()..][..out.len()];
        for (out, trend) in out.iter_mut().zip(trend) {
            // What is clipped stays so, and nothing else becomes it.
            if *out < 1.0 {
                *out = (*out + t * trend).min(1.0 - f32::EPSILON);
            }
        }
    }
}

impl Light {
    /// From a flash, its neighbors before and after, and where its points are in them. Where the three do not show the same, a point's light is that of
    /// its own flash, and does not change.
    fn along(white: &Image, neighbors: [&Image; 2], motion: [&[[f32; 2]]; 2]) -> Self {
        let (w, h, channels) = (white.width, white.height, white.channels);
        // Most of an image is often dark, and nobody asks for its light.
        let lit = |px: &[f32]| px.iter().any(|v| *v > LEAST_LIGHT);
        let [early, late] = [0, 1].map(|n| {
            let mut out = Image::new(w, h, channels);
            out.data.par_chunks_mut(w * channels).enumerate().for_each(|(y, row)| {
                for (x, px) in row.chunks_exact_mut(channels).enumerate() {
                    let at = y * w + x;
                    if !lit(&white.data[at * channels..(at + 1) * channels]) {
                        continue;
                    }
                    let u = motion[n][at];
                    cubic(neighbors[n], [x as f32 + u[0], y as f32 + u[1]], px);
                }
            });
            out
        });
        // How far a pixel's flash is from the mean of the other two, in any channel: an even change cancels. Relative to the light's own
        // noise, whose variance grows with it.
        let far = |i: usize| -> f32 {
            (i * channels..(i + 1) * channels)
                .map(|j| {
                    let (own, early, late) = (white.data[j], early.data[j], late.data[j]);
                    let clipped = own.max(early).max(late) >= 1.0;
                    if clipped { f32::INFINITY } else { (0.5 * (early + late) - own).powi(2) / own.max(LEAST_LIGHT) }
                })
                .fold(0.0, f32::max)
        };
        let asked = (0..w * h).step_by(ASKED_EVERY).filter(|i| white.data[i * channels] > LEAST_LIGHT);
        let mut seen: Vec<f32> = asked.map(far).filter(|far| far.is_finite()).collect();
        let typical = if seen.is_empty() {
            0.0
        } else {
            let mid = seen.len() / 2;
            *seen.select_nth_unstable_by(mid, f32::total_cmp).1
        };
        let (mut now, mut trend) = (white.clone(), Image::new(w, h, channels));
        now.data
            .par_chunks_mut(channels)
            .zip(trend.data.par_chunks_mut(channels))
            .enumerate()
            .with_min_len(w)
            .for_each(|(i, (now, trend))| {
                if !lit(now) {
                    return;
                }
                // All channels or none: a color is not to be mixed of two surfaces.
                let share = 1.0 / (1.0 + (far(i) / (AGREE * typical.max(1e-9))).powi(2));
                for c in 0..channels {
                    let (early, late) = (early.data[i * channels + c], late.data[i * channels + c]);
                    now[c] += share * 2.0 / 3.0 * (0.5 * (early + late) - now[c]);
                    trend[c] = share * 0.5 * (late - early);
                }
            });
        Self { now, trend: smoothed(trend) }
    }
}

/// Light changes evenly over the image, but for noise: means over small squares.
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

/// Flashes whose squared difference is this many times the typical one count half.
const AGREE: f32 = 8.0;
/// Every so many pixels are asked what is typical.
const ASKED_EVERY: usize = 37;
/// Less light than this tells nothing, linear.
const LEAST_LIGHT: f32 = 0.02;
/// Radius of the squares over which the change of light is averaged, px.
const TREND_RADIUS: usize = 1;

/// Pixels whose depths differ by more than this part belong to different surfaces.
const JUMP: f32 = 0.01;

/// An image between pixels (Catmull and Rom 1974), never beyond the values around; clipped where one of the four nearest is.
fn cubic(image: &Image, [x, y]: [f32; 2], out: &mut [f32]) {
    let (w, h, channels) = (image.width, image.height, image.channels);
    let (x, y) = (x.clamp(0.0, w as f32 - 1.0), y.clamp(0.0, h as f32 - 1.0));
    let (x0, y0) = (x.floor(), y.floor());
    let weights = |f: f32| {
        let (f2, f3) = (f * f, f * f * f);
        [-0.5 * f + f2 - 0.5 * f3, 1.0 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2.0 * f2 - 1.5 * f3, 0.5 * (f3 - f2)]
    };
    let (wx, wy) = (weights(x - x0), weights(y - y0));
    let column = |i: usize| (x0 as isize + i as isize - 1).clamp(0, w as isize - 1) as usize;
    let row = |j: usize| (y0 as isize + j as isize - 1).clamp(0, h as isize - 1) as usize;
    for (c, out) in out.iter_mut().enumerate() {
        let at = |i: usize, j: usize| image.data[(row(j) * w + column(i)) * channels + c];
        let mut sum = 0.0;
        for (j, wy) in wy.iter().enumerate() {
            for (i, wx) in wx.iter().enumerate() {
                sum += wx * wy * at(i, j);
            }
        }
        let near = [at(1, 1), at(2, 1), at(1, 2), at(2, 2)];
        let (lo, hi) = near.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        *out = if hi >= 1.0 { hi } else { sum.clamp(lo, hi) };
    }
}

/// Largest part of an image that its neighbor may leave unexplained. Of moving objects it is a few hundredths (their outlines), of a cut a
/// third and more.
const MOST_UNEXPLAINED: f32 = 0.12;

/// The part of the light of image `a` that image `b`, moved by `u`, differs from: Σ |a² − b²| / Σ a² over channels and pixels of square roots.
fn unexplained(a: &[Vec<f32>], b: &[Vec<f32>], u: &[[f32; 2]], [w, h]: [usize; 2]) -> f32 {
    let sums = a.iter().zip(b).map(|(a, b)| {
        let moved = |i: usize| bilinear(b, [w, h], (i % w) as f32 + u[i][0], (i / w) as f32 + u[i][1]);
        let one = |i: usize| f64::from((a[i] * a[i] - moved(i).powi(2)).abs());
        [(0..w * h).map(one).sum::<f64>(), a.iter().map(|v| f64::from(v * v)).sum::<f64>()]
    });
    let [difference, all] = sums.fold([0.0, 0.0], |s, v| [s[0] + v[0], s[1] + v[1]]);
    tracing::debug!(unexplained = difference / all, "motion");
    if all > 0.0 { (difference / all) as f32 } else { 0.0 }
}

/// Times at which the flash is tried first, frames from its own.
const TRIED: [f32; 17] =
    [-1.0, -0.875, -0.75, -0.625, -0.5, -0.375, -0.25, -0.125, 0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0];
/// Most pixels that are asked.
const MOST_ASKED: usize = 12_000;

/// When a pattern was taken, in frames from its flash.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PatternTime {
    /// Negative: the pattern comes first.
    pub frames: f32,
    /// Part of the misfit between codewords and surface that goes away when the flash is drawn at that time.
    pub explained: f32,
}

/// Finds the time of the patterns, near `near` if that is known, for a surface of camera z `depth` (NaN where there is none) in their image. `capture` has the flash as it
/// was taken. `None` if fewer than a hundred pixels can tell.
pub(super) fn pattern_time(
    motion: &Motion,
    near: Option<f32>,
    capture: &Capture,
    depth: &[f32],
    rays: &CameraRays,
    field: &ColorField,
) -> Option<PatternTime> {
    let white = &capture.white;
    let (channels, k) = (white.channels, capture.patterns.len() * white.channels);
    let grid = field.to_grid();
    let lookup = SplineEvaluator::new(&grid, field.metadata.cells_per_pixel);
    let noise = &field.metadata.noise;
    let all: Vec<usize> = (0..depth.len()).filter(|i| depth[*i].is_finite()).collect();
    let asked: Vec<usize> = all.iter().copied().step_by(all.len() / MOST_ASKED + 1).collect();
    if asked.len() < 100 {
        return None;
    }
    let cost = |t: f32| -> f64 {
        let one = |i: &usize| -> f64 {
            let mut c = vec![0.0; k];
            lookup.eval(rays.in_frame(*i).at(f64::from(depth[*i] / rays.dir_z(*i))).q, &mut c);
            let mut flash = vec![0.0; channels];
            motion.light_at(white, (*i % white.width) as f32, (*i / white.width) as f32, t, &mut flash);
            let mut chi2 = 0.0;
            for (m, pattern) in capture.patterns.iter().enumerate() {
                for ch in 0..channels {
                    let own = white.data[i * channels + ch];
                    let black = match &capture.black {
                        Some(black) => black.data[i * channels + ch],
                        None => field.metadata.dark.get(ch).map_or(0.0, |d: &DarkLevel| d.at(own)),
                    };
                    // The weight is that of the flash as taken, so that no time gains from having less light.
                    let light = (own - black).max(1e-3);
                    let variance = noise.normalized_variance(c[m * channels + ch].clamp(0.0, 1.0), light, black);
                    let r =
                        (pattern.data[i * channels + ch] - black - c[m * channels + ch] * (flash[ch] - black)) / light;
                    chi2 += r * r / variance;
                }
            }
            let limit = 9.0 * k as f32;
            f64::from(chi2 / (1.0 + chi2 / limit))
        };
        // Summed in order: the same on any number of threads.
        let costs: Vec<f64> = asked.par_iter().with_min_len(256).map(one).collect();
        costs.iter().sum()
    };
    let still = cost(0.0);
    let (mut frames, mut least) = match near {
        Some(near) => (near, cost(near)),
        None => {
            let tried = TRIED.map(&cost);
            let best = (0..TRIED.len()).min_by(|a, b| tried[*a].total_cmp(&tried[*b])).expect("some were tried");
            (TRIED[best], tried[best])
        }
    };
    // The minimum is smooth: parabolas through ever closer neighbors.
    let mut width = 0.0625;
    for _ in 0..if near.is_some() { 2 } else { 3 } {
        let (a, b) = (cost(frames - width), cost(frames + width));
        let bend = a - 2.0 * least + b;
        let next = frames
            + if bend > 0.0 { (0.5 * (a - b) / bend) as f32 * width } else { 0.0 }.clamp(-1.5 * width, 1.5 * width);
        let there = cost(next);
        if there < least {
            (frames, least) = (next, there);
        }
        width *= 0.4;
    }
    Some(PatternTime { frames, explained: if still > 0.0 { (1.0 - least / still) as f32 } else { 0.0 } })
}

/// The mean of two flashes, the second with the share `share`: the plain way to a flash between the two.
///
/// # Panics
///
/// If they differ in size.
pub(super) fn blend_white(a: &Image, b: &Image, share: f32) -> Image {
    assert!((a.width, a.height, a.channels) == (b.width, b.height, b.channels), "flashes of one camera");
    let mix = |(a, b): (&f32, &f32)| if *a >= 1.0 || *b >= 1.0 { a.max(*b) } else { a * (1.0 - share) + b * share };
    Image { data: a.data.iter().zip(&b.data).map(mix).collect(), ..*a }
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

    /// Under constant acceleration the flash is drawn as it was between frames.
    #[test]
    fn a_flash_is_drawn_at_another_time() {
        let place = |t: f32| 3.0 * t + 0.8 * t * t;
        let motion = Motion::around(Some(&picture(place(-1.0))), &picture(0.0), Some(&picture(place(1.0)))).unwrap();
        for t in [-0.7, -0.25, 0.5] {
            let (drawn, truth) = (motion.flash_at(&picture(0.0), t), picture(place(t)));
            let mut worst = 0.0f32;
            for i in (0..truth.data.len()).filter(|i| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160)))
            {
                worst = worst.max((drawn.data[i] - truth.data[i]).abs());
            }
            assert!(worst < 0.006, "{t}: {worst}");
        }
        assert!((motion.median_px(|_| true) - 3.0).abs() < 0.2);
    }

    /// Light that changes evenly along the way is drawn as it was; what only one flash shows is neither mixed in nor followed. Three flashes
    /// have less noise than one.
    #[test]
    fn light_changes_along_the_way() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, Normal};
        let mut random = rand::rngs::StdRng::seed_from_u64(4);
        let noise = Normal::new(0.0, 0.003f32).unwrap();
        let truth = |t: f32| {
            let mut image = picture(2.0 * t);
            image.data.iter_mut().for_each(|v| *v *= 1.0 + 0.06 * t);
            image
        };
        let mut taken = |t: f32| {
            let mut image = truth(t);
            image.data.iter_mut().for_each(|v| *v += noise.sample(&mut random));
            image
        };
        let (before, white, mut after) = (taken(-1.0), taken(0.0), taken(1.0));
        // Something passes before the camera.
        let covered = |i: usize| (60..90).contains(&(i % 160)) && (40..70).contains(&(i / 160));
        (0..after.data.len()).filter(|i| covered(*i)).for_each(|i| after.data[i] = 0.9);
        let motion = Motion::around(Some(&before), &white, Some(&after)).unwrap();
        let alone = Motion { light: None, ..Motion::around(Some(&before), &white, Some(&after)).unwrap() };
        for t in [-0.5, 0.0, 0.3] {
            let expected = truth(t).data;
            let rms = |drawn: &Image, of: &dyn Fn(usize) -> bool| {
                let inner = |i: &usize| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160));
                let all: Vec<f32> = (0..drawn.data.len())
                    .filter(|i| inner(i) && of(*i))
                    .map(|i| (drawn.data[i] - expected[i]).powi(2))
                    .collect();
                (all.iter().sum::<f32>() / all.len() as f32).sqrt()
            };
            let far = |i: usize| !((45..105).contains(&(i % 160)) && (25..85).contains(&(i / 160)));
            let (with, without) = (motion.flash_at(&white, t), alone.flash_at(&white, t));
            let (a, b) = (rms(&with, &far), rms(&without, &far));
            assert!(a < 0.8 * b && a < 0.003, "{t}: {a}, of one flash {b}");
            let hidden = |i: usize| (66..84).contains(&(i % 160)) && (46..64).contains(&(i / 160));
            let (a, b) = (rms(&with, &hidden), rms(&without, &hidden));
            assert!(a < 1.3 * b + 0.002, "{t}: {a} where one flash shows something else, of one flash {b}");
        }
    }

    /// A surface seen with a picture on it comes along with the picture.
    #[test]
    fn a_surface_is_carried_to_the_next_frame() {
        let place = |t: f32| 3.0 * t + 0.5 * t * t;
        let motion = Motion::around(Some(&picture(place(-1.0))), &picture(0.0), Some(&picture(place(1.0)))).unwrap();
        let t = -0.3;
        let surface =
            |shift: f32| -> Vec<f32> { (0..160 * 120).map(|i| 500.0 + 0.2 * ((i % 160) as f32 - shift)).collect() };
        let (carried, truth) = (motion.carried(&surface(place(t - 1.0)), t), surface(place(t)));
        for i in (0..truth.len()).filter(|i| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160))) {
            assert!((carried[i] - truth[i]).abs() < 0.05, "{i}: {} {}", carried[i], truth[i]);
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

    /// A neighbor that shows something else tells no motion.
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
        let drawn = motion.flash_at(&white, 0.5);
        assert!(drawn.data.iter().any(|v| *v >= 1.0));
        assert!(blend_white(&white, &picture(0.0), 0.5).data[50 * 160 + 70] >= 1.0);
    }
}
