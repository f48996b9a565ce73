//! Pieces of a depth map: connected, and explained about equally well all over.
//!
//! A surface that leaves the calibrated volume, or one behind it, is found at a wrong depth, and often at one that
//! begins where a right one ends: smoothing prefers that. As one component they would be judged by the larger part.

use nelu3d_scan::Camera;
use rayon::prelude::*;

use crate::surface::Links;

/// Radius over which it is told how well pixels are explained, px.
const RADIUS: usize = 4;
/// Ratio of brightness up to which neighbors count as one surface's.
const ALIKE: f32 = 1.2;
/// Pixels on each side of a link whose brightness is compared.
const BEHIND: usize = 3;
/// Misfit beyond which a pixel counts as badly explained.
const BAD: f32 = 1.0;
/// Largest misfit that counts: a single outlier is not what its neighbors share.
const MOST: f32 = 10.0;
/// Smallest well explained piece among badly explained ones, px: smaller ones go with those.
const SMALLEST: u32 = 200;
/// Largest region that goes with a neighbor which is explained better, or worse, as a part of that one's size.
const LARGEST_PART: f32 = 0.25;

/// Returns the piece of each pixel of a depth map (`u32::MAX` where it is NaN) and the pieces' sizes. `links` are those
/// between neighbors of one surface, `light` is white − black; `misfit` tells how badly each pixel is explained, 1 as
/// badly as noise allows.
///
/// A badly explained region stays with a well explained one that it is linked to if it is small beside that and about as
/// bright where they meet: a corner full of interreflection, or a rim that what lies behind it has disturbed. It is a
/// piece of its own where an edge of brightness lies between them. Nor is a small part of a badly explained region right
/// because it happens to be explained.
pub fn pieces(mut links: Links, depth: &[f32], light: &[f32], misfit: &[f32], camera: &Camera) -> (Vec<u32>, Vec<u32>) {
    let w = camera.width;
    let mut bad = are_bad(depth, light, misfit, camera);
    if !bad.contains(&true) {
        return links.components(depth, w);
    }
    let is_edge = |i: usize, j: usize| is_edge(light, depth, [i, j], w);
    let apart = |bad: &[bool], i: usize, j: usize| bad[i] != bad[j] || (bad[i] && is_edge(i, j));
    let mut cut = links.clone();
    cut.cut(w, |i, j| apart(&bad, i, j));
    let (region, sizes) = cut.components(depth, w);
    let mut outlines = vec![Outline::default(); sizes.len()];
    links.for_each(w, |i, j| {
        if bad[i] != bad[j] {
            let is_edge = is_edge(i, j);
            for [own, other] in [[i, j], [j, i]].map(|of| of.map(|i| region[i] as usize)) {
                let outline = &mut outlines[own];
                if is_edge {
                    outline.unlike += 1;
                } else {
                    outline.alike += 1;
                    outline.largest = outline.largest.max(sizes[other]);
                }
            }
        }
    });
    for i in (0..depth.len()).filter(|i| region[*i] != u32::MAX) {
        let (size, outline) = (sizes[region[i] as usize], &outlines[region[i] as usize]);
        let goes_along = outline.is_part_of_neighbor(size) || (!bad[i] && size < SMALLEST);
        bad[i] ^= goes_along;
    }
    links.cut(w, |i, j| apart(&bad, i, j));
    links.components(depth, w)
}

/// What a region meets, of those that are explained better than it, or worse.
#[derive(Clone, Copy, Default)]
struct Outline {
    /// Links to pixels that are about as bright.
    alike: usize,
    /// Links to those that are not.
    unlike: usize,
    /// Size of the largest region beside it that is as bright, px.
    largest: u32,
}

impl Outline {
    /// Returns whether a region of `size` pixels stays with what it meets.
    fn is_part_of_neighbor(&self, size: u32) -> bool {
        self.alike > self.unlike && size as f32 <= LARGEST_PART * self.largest as f32
    }
}

/// Whether brightness has an edge between two linked pixels: what lies behind one is brighter than what lies behind the
/// other, and nowhere near does it change more from one pixel to the next.
pub(super) fn is_edge(light: &[f32], depth: &[f32], [i, j]: [usize; 2], width: usize) -> bool {
    let step = j - i;
    let in_line = |n: isize| {
        let k = i.checked_add_signed(n * step as isize).filter(|k| *k < depth.len() && depth[*k].is_finite())?;
        (step != 1 || k / width == i / width).then(|| light[k])
    };
    let mean = |side: [isize; BEHIND]| {
        let (sum, n) = side.into_iter().map_while(in_line).fold((0.0, 0.0), |(sum, n), l| (sum + l, n + 1.0));
        sum / n
    };
    let [a, b] = [mean([0, -1, -2]), mean([1, 2, 3])];
    let change = |n: isize| in_line(n).zip(in_line(n + 1)).map_or(0.0, |(a, b)| (a - b).abs());
    (a > ALIKE * b || b > ALIKE * a) && [-2, -1, 1, 2].into_iter().all(|n| change(n) <= change(0))
}

/// Whether the pixels around each, those that are about as bright, are badly explained on average. What is behind a
/// surface's outline has its own brightness.
fn are_bad(depth: &[f32], light: &[f32], misfit: &[f32], camera: &Camera) -> Vec<bool> {
    let (w, h) = (camera.width, camera.height);
    let known = |i: usize| depth[i].is_finite() && misfit[i].is_finite();
    let is_bad = |i: usize| {
        if !known(i) {
            return false;
        }
        let (x, y) = (i % w, i / w);
        let [darker, brighter] = [light[i] / ALIKE, light[i] * ALIKE];
        let (mut sum, mut n) = (0.0, 0.0);
        for y in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(h) {
            for j in y * w + x.saturating_sub(RADIUS)..y * w + (x + RADIUS + 1).min(w) {
                if known(j) && light[j] >= darker && light[j] <= brighter {
                    (sum, n) = (sum + misfit[j].min(MOST), n + 1.0);
                }
            }
        }
        sum > BAD * n
    };
    (0..depth.len()).into_par_iter().with_min_len(w).map(is_bad).collect()
}
