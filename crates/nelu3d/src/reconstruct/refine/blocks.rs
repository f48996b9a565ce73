//! Maps that are smooth over many pixels, in blocks of pixels.

use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

/// A map of `side × side` pixels a block; the last column and row of blocks may be narrower.
pub struct Blocks {
    /// Width and height of the map, px.
    size: [usize; 2],
    side: usize,
    /// Blocks across.
    pub width: usize,
    /// Blocks down.
    pub height: usize,
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
    pub fn new(width: usize, height: usize, side: usize) -> Self {
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
    pub fn means<const N: usize>(&self, of: impl Fn(usize) -> [f32; N] + Sync) -> Vec<[f32; N]> {
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
    pub fn smoothed<const N: usize>(&self, means: &[[f32; N]], radius: usize) -> [Vec<f32>; N] {
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
    pub fn at<const N: usize>(&self, values: &[[f32; N]], [x, y]: [usize; 2]) -> [f32; N] {
        let (column, row) = (self.columns[x], self.rows[y]);
        let [above, below] = [row.first, row.second].map(|y| &values[y * self.width..][..self.width]);
        let along = |of: &[[f32; N]], j: usize| column.interpolate(of[column.first][j], of[column.second][j]);
        std::array::from_fn(|j| row.interpolate(along(above, j), along(below, j)))
    }
}
