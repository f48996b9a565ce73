//! Dense optical flow between two images, coarse to fine: each pixel's motion follows from the gradients in its
//! surroundings (Lucas and Kanade 1981), and from its neighbors' motion where these say little.

use nelu3d_scan::image::{bilinear, box_mean};
use rayon::prelude::*;

use super::pyramid::{Level, Pyramid};
use super::vector_map::VectorMap;

/// Linearizations per level.
const ITERATIONS: usize = 4;
/// Radius of the squares, averaged over twice, whose pixels move alike, px.
const RADIUS: usize = 3;
/// Standard deviation of a pixel's motion from that of its surroundings, px.
const SIGMA_PX: f32 = 0.25;

/// Estimates the motion u that takes the pixels of image `a` to those of image `b`: `b(p + u(p)) = a(p)`, in pixels of
/// the full images, at the places of the finest level. Noise should not depend on brightness, as that of the square
/// root of light does not.
///
/// # Panics
///
/// If the images differ in size or channels, or have none.
pub fn flow(a: &Pyramid, b: &Pyramid) -> VectorMap<2> {
    let alike = |a: &Level, b: &Level| a.size == b.size && a.channels.len() == b.channels.len();
    assert!(a.levels.iter().zip(&b.levels).all(|(a, b)| alike(a, b)), "images of one size, of the same channels");
    let (coarsest, finest) = (a.levels.last().expect("a pyramid has a level"), a.finest());
    let mut size = coarsest.size;
    let mut u = vec![[0.0f32; 2]; size[0] * size[1]];
    for (a, b) in a.levels.iter().zip(&b.levels).rev() {
        u = resized(&u, size, a.size);
        size = a.size;
        let noise: Vec<f32> = (0..a.channels.len()).map(|c| a.noise(c)).collect();
        for _ in 0..ITERATIONS {
            improve(a, b, &mut u, &noise);
        }
    }
    let spacing = a.spacing();
    u.par_iter_mut().for_each(|u| *u = [0, 1].map(|c| u[c] * spacing[c]));
    VectorMap { size: finest.size, spacing, values: u }
}

/// Returns the fraction of the light of image `a` that image `b`, warped by the motion `u` from [`flow`], differs from:
/// Σ |a² − b²| / Σ a² over the channels and pixels of the finest level, of square roots of light.
pub(super) fn unexplained(a: &Pyramid, b: &Pyramid, u: &VectorMap<2>) -> f32 {
    let ([w, h], spacing) = (a.finest().size, u.spacing);
    let sums = a.finest().channels.iter().zip(&b.finest().channels).map(|(a, b)| {
        let warped = |i: usize| bilinear(b, [w, h], warped_position(i, w, [0, 1].map(|c| u.values[i][c] / spacing[c])));
        let one = |i: usize| f64::from((a[i] * a[i] - warped(i).powi(2)).abs());
        [(0..w * h).map(one).sum::<f64>(), a.iter().map(|v| f64::from(v * v)).sum::<f64>()]
    });
    let [difference, all] = sums.fold([0.0, 0.0], |s, v| [s[0] + v[0], s[1] + v[1]]);
    tracing::debug!(unexplained = difference / all, "motion");
    if all > 0.0 { (difference / all) as f32 } else { 0.0 }
}

/// Improves the motion `u` from image `a` to image `b` at one scale by one linearization about it; `noise` has the
/// noise variance of each channel.
fn improve(a: &Level, b: &Level, u: &mut [[f32; 2]], noise: &[f32]) {
    let [w, h] = a.size;
    // Σ gx², gx gy, gy², gx r, gy r over channels, with g the mean gradient of both images; in units of the noise,
    // so that channels weigh by their precision.
    let mut sums: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; w * h]);
    for ((a, b), noise) in a.channels.iter().zip(&b.channels).zip(noise) {
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

/// Returns where pixel `i` of an image of width `width` lies after a motion `u`, px.
fn warped_position(i: usize, width: usize, u: [f32; 2]) -> [f64; 2] {
    [f64::from((i % width) as f32 + u[0]), f64::from((i / width) as f32 + u[1])]
}

/// Returns a motion at another scale, in pixels of that scale.
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
