//! The fast form: tiles that stay in a cache, two colors one after the other, the tiles of one color in parallel.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::solve::{TileResult, solve};
use super::tile::{CORE, SIDE, Tile};
use super::{PlateStop, PlateSystem};
use crate::bench::Demand;

/// What a sweep came to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sweep {
    /// Sum of the absolute changes of all pixels.
    pub change: f64,
    /// Products of a tile with its matrix, all tiles together.
    pub products: usize,
    /// Tiles that were solved.
    pub tiles: usize,
}

impl Sweep {
    /// Returns what the sweep asked of the machine: 26 operations of a product per pixel of a tile, 18 of the rest of
    /// an iteration. A tile's maps are read and written once; then they stay in a cache.
    pub fn demand(&self) -> Demand {
        let pixels = (SIDE * SIDE) as f64;
        let flops = 44.0 * pixels * self.products as f64 + 60.0 * pixels * self.tiles as f64;
        Demand { flops, bytes: 4.0 * 10.0 * pixels * self.tiles as f64, ..Demand::default() }
    }
}

/// Goes through all tiles once: changes `x` in each to what is best with the others at rest, by at most `limit` a
/// pixel. Number `turn` of a row of sweeps decides where tiles lie. `x` is 0 where it is not active. The result does
/// not depend on the number of threads.
///
/// # Panics
///
/// If a length does not fit.
pub fn sweep(system: &PlateSystem<'_>, x: &mut [f32], turn: usize, limit: f32, until: PlateStop) -> Sweep {
    system.check(x);
    let mut out = Sweep::default();
    let corners = corners(system, turn);
    for color in 0..2 {
        let of_color = corners.iter().filter(|(c, _)| *c == color).map(|(_, corner)| *corner).collect::<Vec<_>>();
        let surface = &*x;
        let solved: Vec<Option<TileResult>> = of_color
            .par_iter()
            .map_init(Tile::new, |tile, corner| {
                Arch::new().dispatch(SolveTile { tile, system, x: surface, corner: *corner, until })
            })
            .collect();
        for (corner, tile) in of_color.iter().zip(solved).filter_map(|(corner, tile)| Some((corner, tile?))) {
            out.tiles += 1;
            out.products += tile.products;
            out.change += apply(system, x, *corner, &tile.change, limit);
        }
    }
    out
}

/// Returns color and corner of every tile of a turn: a chessboard that is moved by a part of a tile, another one each
/// turn.
fn corners(system: &PlateSystem<'_>, turn: usize) -> Vec<(usize, [isize; 2])> {
    // Multiples of numbers near the golden section of a tile spread evenly over it.
    let moved = [turn * 38 % CORE, turn * 23 % CORE];
    let [across, down] =
        [(system.width, moved[0]), (system.height, moved[1])].map(|(n, moved)| (n + moved).div_ceil(CORE));
    let corner = |tile: usize, moved: usize| (tile * CORE) as isize - moved as isize - 1;
    (0..across * down)
        .map(|i| {
            let (x, y) = (i % across, i / across);
            ((x + y) % 2, [corner(x, moved[0]), corner(y, moved[1])])
        })
        .collect()
}

/// Adds the change of a tile's inside to the surface; returns the sum of its absolute values.
fn apply(system: &PlateSystem<'_>, x: &mut [f32], corner: [isize; 2], change: &[f32], limit: f32) -> f64 {
    let mut sum = 0.0;
    for (y, change) in change.chunks_exact(CORE).enumerate() {
        let Some(row) = super::tile::row_of(corner[1], y + 1, system.height) else { continue };
        for (column, change) in change.iter().enumerate() {
            let column = corner[0] + 1 + column as isize;
            if *change != 0.0 && (0..system.width as isize).contains(&column) {
                let by = change.clamp(-limit, limit);
                x[row * system.width + column as usize] += by;
                sum += f64::from(by.abs());
            }
        }
    }
    sum
}

struct SolveTile<'a> {
    tile: &'a mut Tile,
    system: &'a PlateSystem<'a>,
    x: &'a [f32],
    corner: [isize; 2],
    until: PlateStop,
}

impl WithSimd for SolveTile<'_> {
    type Output = Option<TileResult>;
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Option<TileResult> {
        solve(self.tile, self.system, self.x, self.corner, self.until)
    }
}
