//! Conjugate gradients within one tile.

use super::product::{product, residual_of_surface, settle};
use super::tile::{AHEAD, CORE, SIDE, Tile};
use super::{PlateStop, PlateSystem};

/// What a tile came to.
pub(super) struct TileResult {
    /// Change of the tile's inside, `CORE × CORE`.
    pub(super) change: Vec<f32>,
    /// Products with the matrix.
    pub(super) products: usize,
}

/// Solves the tile whose ring begins at `corner` (x, y), which may lie outside the window; `None` where it has no
/// active pixel.
#[inline(always)]
pub(super) fn solve(
    tile: &mut Tile,
    system: &PlateSystem<'_>,
    x: &[f32],
    corner: [isize; 2],
    until: PlateStop,
) -> Option<TileResult> {
    let n_active = tile.load(system, corner);
    if n_active == 0 {
        return None;
    }
    residual_of_surface(tile, system, x, corner);
    let mut rz = settle(tile, 0.0);
    let enough = (until.reduction * until.reduction * rz).max(until.settled * n_active as f64);
    let (mut products, mut beta) = (0, 0.0);
    while products < until.iterations && rz > enough {
        let pap = product(tile, beta);
        products += 1;
        if pap <= 0.0 {
            break;
        }
        let next = settle(tile, (rz / pap) as f32);
        beta = (next / rz) as f32;
        rz = next;
    }
    let mut change = Vec::with_capacity(CORE * CORE);
    for y in 1..=CORE {
        change.extend_from_slice(&tile.change[AHEAD + y * SIDE + 1..][..CORE]);
    }
    Some(TileResult { change, products })
}
