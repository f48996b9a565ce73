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
}

impl Blocks {
    /// Divides a map of so many columns and rows of pixels.
    pub(super) fn new(width: usize, height: usize, side: usize) -> Self {
        Self { size: [width, height], side, width: width.div_ceil(side), height: height.div_ceil(side) }
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

    /// Returns the values at pixel `i`, interpolated between the middles of blocks.
    pub(super) fn at<const N: usize>(&self, values: &[[f32; N]], i: usize) -> [f32; N] {
        if self.side == 1 {
            return values[i];
        }
        let place = |at: usize, n: usize| {
            let at = ((at as f32 + 0.5) / self.side as f32 - 0.5).clamp(0.0, n as f32 - 1.0);
            (at as usize, (at as usize + 1).min(n - 1), at.fract())
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (place(i % self.size[0], self.width), place(i / self.size[0], self.height));
        std::array::from_fn(|j| {
            let along = |y: usize| {
                let row = &values[y * self.width..];
                row[x0][j] * (1.0 - fx) + row[x1][j] * fx
            };
            along(y0) * (1.0 - fy) + along(y1) * fy
        })
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
                let i = y * w + x;
                let found = blocks.at(&means, i);
                assert!(found.iter().zip(ramp(i)).all(|(a, b)| (a - b).abs() < 1e-3), "{side}: {found:?}");
            }
            // And averaged over squares that lie within the map.
            let smooth = blocks.smoothed(&means, 20);
            let middle = blocks.height / 2 * blocks.width + blocks.width / 2;
            let off: [f32; 2] = std::array::from_fn(|j| (smooth[j][middle] - means[middle][j]).abs());
            assert!(off.iter().all(|v| *v < 1e-3), "{side}: {off:?}");
        }
    }
}
