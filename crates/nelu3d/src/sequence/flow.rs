//! Dense optical flow between two images, coarse to fine: each pixel's motion follows from the gradients in its
//! surroundings (Lucas and Kanade 1981), and from its neighbors' motion where these say little.

use nelu3d_scan::image::{bilinear, box_mean};
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

/// Number of pixels to which images are reduced before the flow is estimated: motion changes slowly over an image.
const MAX_PIXELS: usize = 60_000;
/// Smallest side of the coarsest image, px.
const MIN_SIDE: usize = 20;
/// Linearizations per level.
const ITERATIONS: usize = 4;
/// Radius of the squares, averaged over twice, whose pixels move alike, px.
const RADIUS: usize = 3;
/// Standard deviation of a pixel's motion from that of its surroundings, px.
const SIGMA_PX: f32 = 0.25;

/// Estimates the motion u that takes the pixels of `a` to those of `b`: `b(p + u(p)) = a(p)`, px. Both are channels of
/// `height × width` values, because a surface may vary in color alone. Noise should not depend on brightness, as that
/// of the square root of light does not.
///
/// # Panics
///
/// If there are no channels, or one has another size.
pub(super) fn flow(a: &[Vec<f32>], b: &[Vec<f32>], width: usize, height: usize) -> Vec<[f32; 2]> {
    assert!(!a.is_empty() && a.len() == b.len(), "images of the same channels");
    assert!(a.iter().chain(b).all(|v| v.len() == width * height), "images of one size");
    let mut levels = vec![Level { width, height, a: a.to_vec(), b: b.to_vec() }];
    while levels.last().is_some_and(|l| l.width.min(l.height) >= 2 * MIN_SIDE) {
        let half = levels.last().expect("there is one").half();
        levels.push(half);
    }
    let finest = levels.iter().position(|l| l.width * l.height <= MAX_PIXELS).unwrap_or(levels.len() - 1);
    let coarsest = levels.last().expect("there is one");
    let mut size = [coarsest.width, coarsest.height];
    let mut u = vec![[0.0f32; 2]; size[0] * size[1]];
    for level in levels[finest..].iter().rev() {
        u = resized(&u, size, [level.width, level.height]);
        size = [level.width, level.height];
        let noise: Vec<f32> = (0..level.a.len()).map(|c| level.noise(c)).collect();
        for _ in 0..ITERATIONS {
            level.improve(&mut u, &noise);
        }
    }
    resized(&u, size, [width, height])
}

/// Both images at one scale.
struct Level {
    width: usize,
    height: usize,
    a: Vec<Vec<f32>>,
    b: Vec<Vec<f32>>,
}

impl Level {
    /// Returns the level of half the size, of means over 2 × 2 pixels.
    fn half(&self) -> Self {
        let (w, h) = (self.width / 2, self.height / 2);
        let reduce = |v: &Vec<f32>| -> Vec<f32> {
            let of = |i: usize| {
                let at = 2 * (i / w) * self.width + 2 * (i % w);
                0.25 * (v[at] + v[at + 1] + v[at + self.width] + v[at + self.width + 1])
            };
            (0..w * h).map(of).collect()
        };
        Self { width: w, height: h, a: self.a.iter().map(reduce).collect(), b: self.b.iter().map(reduce).collect() }
    }

    /// Returns the noise variance of one pixel in a channel, from the second differences in the quieter half of the
    /// image.
    fn noise(&self, channel: usize) -> f32 {
        let rows = self.a[channel].chunks_exact(self.width);
        let mut d: Vec<f32> =
            rows.flat_map(|r| r.windows(3).step_by(3).map(|v| (v[0] - 2.0 * v[1] + v[2]).powi(2) / 6.0)).collect();
        // The median of a squared normal variable is 0.455 of its mean.
        median(&mut d).map_or(1e-6, |middle| (middle / 0.455).max(1e-7))
    }

    /// Improves the motion by one linearization about it.
    fn improve(&self, u: &mut [[f32; 2]], noise: &[f32]) {
        let (w, h) = (self.width, self.height);
        // Σ gx², gx gy, gy², gx r, gy r over channels, with g the mean gradient of both images; in units of the noise,
        // so that channels weigh by their precision.
        let mut sums: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; w * h]);
        for ((a, b), noise) in self.a.iter().zip(&self.b).zip(noise) {
            // Both images have noise.
            let variance = 2.0 * noise;
            let warped: Vec<f32> = (0..w * h)
                .into_par_iter()
                .with_min_len(w)
                .map(|i| bilinear(b, [w, h], warped_position(i, w, u[i])))
                .collect();
            let n = w.saturating_sub(2);
            for y in 1..h - 1 {
                // A row's inner pixels and their neighbors, in slices of one length: the loop below needs no checks.
                let at = y * w + 1;
                let [xx, xy, yy, xr, yr] = sums.each_mut().map(|s| &mut s[at..at + n]);
                let [a0, a1, a2, a3, a4] = [at, at - 1, at + 1, at - w, at + w].map(|i| &a[i..i + n]);
                let [b0, b1, b2, b3, b4] = [at, at - 1, at + 1, at - w, at + w].map(|i| &warped[i..i + n]);
                for i in 0..n {
                    let gx = 0.25 * (a2[i] - a1[i] + b2[i] - b1[i]);
                    let gy = 0.25 * (a4[i] - a3[i] + b4[i] - b3[i]);
                    let r = a0[i] - b0[i];
                    // What one image alone shows (covered, or in a highlight) does not tell motion.
                    let weight = 1.0 / (variance * (1.0 + r * r / (25.0 * variance)));
                    xx[i] += weight * (gx * gx);
                    xy[i] += weight * (gx * gy);
                    yy[i] += weight * (gy * gy);
                    xr[i] += weight * (gx * r);
                    yr[i] += weight * (gy * r);
                }
            }
        }
        let mut means: [Vec<f32>; 2] = [0, 1].map(|c| u.iter().map(|u| u[c]).collect());
        sums.par_iter_mut().chain(&mut means).for_each(|v| {
            for _ in 0..2 {
                box_mean(v, w, h, RADIUS);
            }
        });
        let mut inside = vec![1.0f32; w * h];
        for _ in 0..2 {
            box_mean(&mut inside, w, h, RADIUS);
        }
        // Two passes of a box average over about as many pixels as one box of √2 times its side.
        let pixels = 2.0 * ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
        let stiffness = 1.0 / (pixels * SIGMA_PX * SIGMA_PX);
        u.par_iter_mut().enumerate().with_min_len(w).for_each(|(i, u)| {
            let mean = [means[0][i] / inside[i], means[1][i] / inside[i]];
            let [xx, xy, yy, xr, yr] = [0, 1, 2, 3, 4].map(|j| sums[j][i]);
            let (p, q) = (xx + stiffness, yy + stiffness);
            // (G + stiffness) (u′ − u) = g r + stiffness (mean − u)
            let (f, g) = (xr + stiffness * (mean[0] - u[0]), yr + stiffness * (mean[1] - u[1]));
            let det = p * q - xy * xy;
            let step = [(q * f - xy * g) / det, (p * g - xy * f) / det];
            for c in 0..2 {
                // A linearization holds for about a pixel.
                u[c] += step[c].clamp(-1.5, 1.5);
            }
        });
    }
}

/// Returns where pixel `i` of an image of width `width` lies after a motion `u`, px.
pub(super) fn warped_position(i: usize, width: usize, u: [f32; 2]) -> [f64; 2] {
    [f64::from((i % width) as f32 + u[0]), f64::from((i / width) as f32 + u[1])]
}

/// Returns a motion field at another scale, in pixels of that scale.
fn resized(u: &[[f32; 2]], from: [usize; 2], to: [usize; 2]) -> Vec<[f32; 2]> {
    if from == to {
        return u.to_vec();
    }
    let scale = [0, 1].map(|c| to[c] as f32 / from[c] as f32);
    let parts: [Vec<f32>; 2] = [0, 1].map(|c| u.iter().map(|u| u[c] * scale[c]).collect());
    (0..to[0] * to[1])
        .into_par_iter()
        .with_min_len(to[0])
        .map(|i| {
            let at = |p: usize, c: usize| (p as f32 + 0.5) / scale[c] - 0.5;
            let (x, y) = (at(i % to[0], 0), at(i / to[0], 1));
            [0, 1].map(|c| bilinear(&parts[c], from, [x, y].map(f64::from)))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known motion of a smooth texture is found to a few hundredths of a pixel, also where it is larger than the
    /// surroundings that decide on a pixel.
    #[test]
    fn known_motion_is_found() {
        let (w, h) = (200, 150);
        let texture = |x: f32, y: f32| {
            0.5 + 0.12 * (0.23 * x + 0.11 * y).sin() + 0.1 * (0.31 * y - 0.07 * x).cos() + 0.1 * (0.05 * x * 1.3).sin()
        };
        for shift in [[0.3f32, -0.2], [2.4, 1.1], [-9.0, 5.5]] {
            // Rotation by a hundredth about the middle, and the shift.
            let motion = |x: f32, y: f32| [shift[0] - 0.01 * (y - 75.0), shift[1] + 0.01 * (x - 100.0)];
            let a: Vec<f32> = (0..w * h)
                .map(|i| {
                    let (x, y) = ((i % w) as f32, (i / w) as f32);
                    let u = motion(x, y);
                    texture(x + u[0], y + u[1])
                })
                .collect();
            let b: Vec<f32> = (0..w * h).map(|i| texture((i % w) as f32, (i / w) as f32)).collect();
            let found = flow(&[a], &[b], w, h);
            let mut errors: Vec<f32> = (0..w * h)
                .filter(|i| (20..w - 20).contains(&(i % w)) && (20..h - 20).contains(&(i / w)))
                .map(|i| {
                    let u = motion((i % w) as f32, (i / w) as f32);
                    (found[i][0] - u[0]).hypot(found[i][1] - u[1])
                })
                .collect();
            errors.sort_by(f32::total_cmp);
            assert!(errors[errors.len() / 2] < 0.03, "{shift:?}: median {}", errors[errors.len() / 2]);
            assert!(errors[errors.len() * 19 / 20] < 0.1, "{shift:?}: 95 % {}", errors[errors.len() * 19 / 20]);
        }
    }

    /// The motion of a surface that varies in color alone is found.
    #[test]
    fn color_alone_tells_motion() {
        let (w, h) = (120, 90);
        let wave = |x: f32, y: f32| 0.1 * ((0.25 * x).sin() + (0.3 * y + 1.0).cos());
        let image = |shift: [f32; 2]| -> Vec<Vec<f32>> {
            let of = |sign: f32| {
                let at = |i: usize| 0.5 + sign * wave((i % w) as f32 - shift[0], (i / w) as f32 - shift[1]);
                (0..w * h).map(at).collect()
            };
            vec![of(1.0), of(-1.0)]
        };
        let u = flow(&image([0.0; 2]), &image([3.0, -1.5]), w, h);
        let middle = u[45 * w + 60];
        assert!((middle[0] - 3.0).hypot(middle[1] + 1.5) < 0.1, "{middle:?}");
    }

    /// Noise alone moves an empty image by less than a pixel.
    #[test]
    fn an_empty_image_hardly_moves() {
        use rand::{RngExt, SeedableRng};
        let (w, h) = (90, 70);
        let mut rng = rand::rngs::StdRng::seed_from_u64(3);
        let mut noise = || (0..w * h).map(|_| 0.2 + 0.01 * rng.random::<f32>()).collect::<Vec<f32>>();
        let (a, b) = (noise(), noise());
        let u = flow(&[a], &[b], w, h);
        let mean = u.iter().map(|u| u[0].hypot(u[1])).sum::<f32>() / u.len() as f32;
        assert!(mean < 1.0, "{mean}");
    }
}
