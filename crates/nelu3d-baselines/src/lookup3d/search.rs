//! Which positions a pixel is compared with.

use nelu3d_field::nearest::Hit;
use rayon::prelude::*;

use super::options::SearchSettings;
use super::table::Table;

/// Where to look first, for every pixel of the table; outside of it only where that finds nothing good.
pub(crate) struct Windows {
    /// First position, and the one after the last.
    ranges: Vec<[u32; 2]>,
}

impl Windows {
    /// Makes windows from the positions of every `coarse`th pixel, decoded by brute force: for the pixels between them
    /// everything between what their surroundings found, and `window` positions more on either side. Where these are
    /// far apart, everything.
    pub(crate) fn coarse_to_fine(
        table: &Table,
        queries: &(dyn Fn(usize, &mut [f32]) + Sync),
        s: &SearchSettings,
    ) -> Self {
        let shape = *table.shape();
        let coarse = s.coarse.max(1);
        let (w, h) = (shape.width.div_ceil(coarse), shape.height.div_ceil(coarse));
        let hits: Vec<Hit> = (0..w * h)
            .into_par_iter()
            .map_init(
                || vec![0.0; shape.k],
                |query, i| {
                    let pixel = i / w * coarse * shape.width + i % w * coarse;
                    queries(pixel, query);
                    let mut hit = [Hit::NONE];
                    table.nearest(pixel, query, None, &mut hit);
                    hit[0]
                },
            )
            .collect();
        let p = shape.n_positions as u32;
        let window = s.window.max(1) as u32;
        let range = |pixel: usize| {
            let (x, y) = (pixel % shape.width / coarse, pixel / shape.width / coarse);
            let (mut lo, mut hi) = (u32::MAX, 0);
            for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
                let hit = hits[y.min(h - 1) * w + x.min(w - 1)];
                if hit.index != u32::MAX {
                    (lo, hi) = (lo.min(hit.index), hi.max(hit.index));
                }
            }
            if lo > hi || hi - lo > p / 2 {
                return [0, p];
            }
            [lo.saturating_sub(window), (hi + window + 1).min(p)]
        };
        Self { ranges: (0..shape.n_pixels()).into_par_iter().map(range).collect() }
    }

    /// Makes windows around the depth of an earlier result, `depth(pixel)` in mm (NaN: none), `window` positions on
    /// either side.
    pub(crate) fn near(table: &Table, depth: &(dyn Fn(usize) -> f32 + Sync), window: usize) -> Self {
        let p = table.shape().n_positions;
        let range = |pixel: usize| {
            let before = depth(pixel);
            let off = |q: usize| (table.depth(pixel, q) - before).abs();
            let closest = (0..p).filter(|q| !off(*q).is_nan()).min_by(|a, b| off(*a).total_cmp(&off(*b)));
            closest.map_or([0, p as u32], |q| {
                [q.saturating_sub(window.max(1)) as u32, (q + window.max(1) + 1).min(p) as u32]
            })
        };
        Self { ranges: (0..table.shape().n_pixels()).into_par_iter().map(range).collect() }
    }

    /// Returns the windows of the pixels from `first` on.
    pub(crate) fn of(&self, first: usize, n: usize) -> &[[u32; 2]] {
        &self.ranges[first..first + n]
    }

    /// Returns whether a position may only be the best of those that were looked at: at the border of a window.
    pub(crate) fn at_border(range: [u32; 2], index: u32, n_positions: usize) -> bool {
        (index == range[0] && range[0] > 0) || (index + 1 == range[1] && (range[1] as usize) < n_positions)
    }
}
