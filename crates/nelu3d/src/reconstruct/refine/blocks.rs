//! Maps that are smooth over many pixels, in blocks of pixels.

use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

/// A map of `side × side` pixels a block; the last column and row of blocks may be narrower.
pub(super) struct Blocks {
    /// Width and height of the map, px.
    size: [usize; 2],
    side: usize,
    /// Blocks across.
    pub(super) width: usize,
    /// Blocks down.
    height: usize,
    /// Per column of pixels, the blocks whose middles are beside it, and how much of the way lies behind it.
    columns: Vec<Between>,
    /// Per row of pixels, the blocks whose middles are above and below it, and how much of the way lies behind it.
    rows: Vec<Between>,
}

/// A place between two values.
#[derive(Clone, Copy)]
struct Between {
    first: usize,
    second: usize,
    /// Part of the way from the first to the second.
    part: f32,
}

impl Between {
    /// The places of `size` pixels between the middles of `n` blocks of a `side`; beyond the first and the last, these.
    fn of_pixels(size: usize, n: usize, side: usize) -> Vec<Self> {
        let place = |at: usize| {
            let at = ((at as f32 + 0.5) / side as f32 - 0.5).clamp(0.0, n as f32 - 1.0);
            Self { first: at as usize, second: (at as usize + 1).min(n - 1), part: at.fract() }
        };
        (0..size).map(place).collect()
    }

    fn interpolate(&self, first: f32, second: f32) -> f32 {
        first + self.part * (second - first)
    }
}

impl Blocks {
    /// Divides a map of so many columns and rows of pixels.
    pub(super) fn new(width: usize, height: usize, side: usize) -> Self {
        let n = [width, height].map(|size| size.div_ceil(side));
        Self {
            size: [width, height],
            side,
            width: n[0],
            height: n[1],
            columns: Between::of_pixels(width, n[0], side),
            rows: Between::of_pixels(height, n[1], side),
        }
    }

    /// Returns the number of blocks.
    pub(super) fn n(&self) -> usize {
        self.width * self.height
    }

    /// Returns the sums of `of` over the pixels of every block, divided by the number of pixels of a whole one.
    pub(super) fn means<const N: usize>(&self, of: impl Fn(usize) -> [f32; N] + Sync) -> Vec<[f32; N]> {
        let [w, h] = self.size;
        let norm = 1.0 / (self.side * self.side) as f32;
        let block = |i: usize| {
            let [x, y] = [i % self.width * self.side, i / self.width * self.side];
            let mut sums = [0.0f32; N];
            for row in y..(y + self.side).min(h) {
                for column in x..(x + self.side).min(w) {
                    sums.iter_mut().zip(of(row * w + column)).for_each(|(sum, v)| *sum += v);
                }
            }
            sums.map(|sum| sum * norm)
        };
        (0..self.n()).into_par_iter().with_min_len(self.width).map(block).collect()
    }

    /// Returns the values of every block, each averaged twice over squares of `radius` pixels around.
    pub(super) fn smoothed<const N: usize>(&self, means: &[[f32; N]], radius: usize) -> [Vec<f32>; N] {
        let mut maps: [Vec<f32>; N] = std::array::from_fn(|_| Vec::new());
        maps.par_iter_mut().enumerate().for_each(|(j, map)| {
            *map = means.iter().map(|v| v[j]).collect();
            for _ in 0..2 {
                box_mean(map, self.width, self.height, radius / self.side);
            }
        });
        maps
    }

    /// Returns the values at pixel (x, y), interpolated between the middles of blocks.
    #[inline]
    pub(super) fn at<const N: usize>(&self, values: &[[f32; N]], [x, y]: [usize; 2]) -> [f32; N] {
        let (column, row) = (self.columns[x], self.rows[y]);
        let [above, below] = [row.first, row.second].map(|y| &values[y * self.width..][..self.width]);
        let along = |of: &[[f32; N]], j: usize| column.interpolate(of[column.first][j], of[column.second][j]);
        std::array::from_fn(|j| row.interpolate(along(above, j), along(below, j)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_smooth_is_the_same_in_blocks() {
        let (w, h) = (130, 100);
        let ramp = |i: usize| [(i % w) as f32, 2.0 * (i / w) as f32 - 7.0];
        for side in [1, 4, 10] {
            let blocks = Blocks::new(w, h, side);
            let means = blocks.means(ramp);
            // Between the middles of whole blocks.
            for (x, y) in [(10, 10), (51, 44), (w - 20, h - 20)] {
                let found = blocks.at(&means, [x, y]);
                assert!(found.iter().zip(ramp(y * w + x)).all(|(a, b)| (a - b).abs() < 1e-3), "{side}: {found:?}");
            }
            // And averaged over squares that lie within the map.
            let smooth = blocks.smoothed(&means, 20);
            let middle = blocks.height / 2 * blocks.width + blocks.width / 2;
            let off: [f32; 2] = std::array::from_fn(|j| (smooth[j][middle] - means[middle][j]).abs());
            assert!(off.iter().all(|v| *v < 1e-3), "{side}: {off:?}");
        }
    }
}
