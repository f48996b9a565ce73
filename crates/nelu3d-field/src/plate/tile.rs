//! The memory of one tile: a square of pixels that is solved with its outermost ring, and all beyond, at rest.

use super::PlateSystem;

/// Pixels across a tile: its maps fill half of a second-level cache.
pub(super) const SIDE: usize = 64;
/// Pixels of a tile.
pub(super) const PIXELS: usize = SIDE * SIDE;
/// Zeros before and behind a map of a tile.
pub(super) const AHEAD: usize = SIDE + 16;
/// Pixels across the inside of a tile, which changes.
pub(super) const CORE: usize = SIDE - 2;

/// The memory of one tile. All maps have [`SIDE`] × [`SIDE`] pixels, row by row without gaps, with zeros before and
/// behind: what reaches over the end of a row meets the ring, which is at rest.
pub(super) struct Tile {
    pub(super) xx: Vec<f32>,
    pub(super) yy: Vec<f32>,
    pub(super) xy: Vec<f32>,
    pub(super) h: Vec<f32>,
    /// One over the diagonal of the system; 0 for pixels at rest.
    pub(super) inverse: Vec<f32>,
    /// Weighted differences of what the matrix is applied to.
    pub(super) differences: [Vec<f32>; 3],
    pub(super) p: Vec<f32>,
    pub(super) ap: Vec<f32>,
    pub(super) r: Vec<f32>,
    pub(super) change: Vec<f32>,
}

impl Tile {
    /// Allocates a tile.
    pub(super) fn new() -> Self {
        let zeros = || vec![0.0f32; PIXELS + 2 * AHEAD];
        Self {
            xx: zeros(),
            yy: zeros(),
            xy: zeros(),
            h: zeros(),
            inverse: zeros(),
            differences: [zeros(), zeros(), zeros()],
            p: zeros(),
            ap: zeros(),
            r: zeros(),
            change: zeros(),
        }
    }

    /// Copies the system's part under the tile; returns the number of active pixels in its inside.
    pub(super) fn load(&mut self, system: &PlateSystem<'_>, corner: [isize; 2]) -> usize {
        let Self { xx, yy, xy, h, inverse, p, r, change, .. } = self;
        for map in [&mut *xx, yy, xy, h, inverse, p, r, change] {
            map[AHEAD..AHEAD + PIXELS].fill(0.0);
        }
        let (here, in_window) = columns(corner[0], system.width);
        for y in 0..SIDE {
            let Some(row) = row_of(corner[1], y, system.height) else { continue };
            let at = AHEAD + y * SIDE + here;
            let from = row * system.width + in_window.start..row * system.width + in_window.end;
            for (to, map) in [(&mut *xx, system.xx), (yy, system.yy), (xy, system.xy), (h, system.h)] {
                to[at..at + from.len()].copy_from_slice(&map[from.clone()]);
            }
        }
        let mut n_active = 0;
        for y in 1..=CORE {
            let Some(row) = row_of(corner[1], y, system.height) else { continue };
            for column in 1..=CORE {
                let in_window = corner[0] + column as isize;
                if !(0..system.width as isize).contains(&in_window) {
                    continue;
                }
                if system.active[row * system.width + in_window as usize] {
                    n_active += 1;
                    let i = AHEAD + y * SIDE + column;
                    let straight = xx[i - 1] + 4.0 * xx[i] + xx[i + 1] + yy[i - SIDE] + 4.0 * yy[i] + yy[i + SIDE];
                    let mixed = xy[i] + xy[i - 1] + xy[i - SIDE] + xy[i - SIDE - 1];
                    let diagonal = h[i] + straight + mixed;
                    inverse[i] = if diagonal > 0.0 { 1.0 / diagonal } else { 0.0 };
                }
            }
        }
        n_active
    }
}

/// Returns the window's row of row `y` of a tile; `None` outside of it.
pub(super) fn row_of(corner: isize, y: usize, height: usize) -> Option<usize> {
    usize::try_from(corner + y as isize).ok().filter(|row| *row < height)
}

/// Returns the first column of a tile that lies in a window of some width, and the columns of the window under it.
pub(super) fn columns(corner: isize, width: usize) -> (usize, std::ops::Range<usize>) {
    let start = corner.max(0).min(width as isize);
    let end = (corner + SIDE as isize).clamp(start, width as isize);
    ((start - corner) as usize, start as usize..end as usize)
}
