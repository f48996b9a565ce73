//! The inner loops of a tile, over rows of a length that the compiler knows. They are inlined into a function that is
//! dispatched to the machine's vectors.

use super::PlateSystem;
use super::tile::{AHEAD, SIDE, Tile, columns, row_of};

/// Partial sums that are taken side by side.
const SUMS: usize = 16;

/// Returns `SIDE` values from a place on.
#[inline(always)]
fn from(v: &[f32], at: usize) -> &[f32; SIDE] {
    v[at..at + SIDE].first_chunk().expect("a row")
}

/// Returns `SIDE` values from a place on, to be written.
#[inline(always)]
fn from_mut(v: &mut [f32], at: usize) -> &mut [f32; SIDE] {
    v[at..at + SIDE].first_chunk_mut().expect("a row")
}

/// Moves along p ← r / diagonal + β p, and computes (diag(h) + DᵀWD) p; returns ⟨p, that⟩.
#[inline(always)]
pub(super) fn product(t: &mut Tile, beta: f32) -> f64 {
    let mut sums = [0.0f32; SUMS];
    direction(t, AHEAD, beta);
    for y in 0..SIDE {
        let at = AHEAD + y * SIDE;
        if y + 1 < SIDE {
            direction(t, at + SIDE, beta);
        }
        let p = &t.p;
        weighted_differences(
            [from(p, at - 1), from(p, at), from(p, at + 1)],
            [from(p, at - SIDE), from(p, at + SIDE), from(p, at + SIDE + 1)],
            [from(&t.xx, at), from(&t.yy, at), from(&t.xy, at)],
            t.differences.each_mut().map(|d| from_mut(d, at)),
        );
        if y >= 2 {
            let row = at - SIDE;
            let mut sum = transposed(&t.differences, row);
            let (h, p) = (from(&t.h, row), from(&t.p, row));
            for i in 0..SIDE {
                sum[i] += h[i] * p[i];
            }
            *from_mut(&mut t.ap, row) = sum;
            for i in (0..SIDE).step_by(SUMS) {
                for l in 0..SUMS {
                    sums[l] += sum[i + l] * p[i + l];
                }
            }
        }
    }
    total(sums)
}

/// Takes a step along p; returns the squared norm of the residual that is left.
#[inline(always)]
pub(super) fn settle(t: &mut Tile, step: f32) -> f64 {
    let mut sums = [0.0f32; SUMS];
    for y in 1..SIDE - 1 {
        let at = AHEAD + y * SIDE;
        let (p, ap, inverse) = (from(&t.p, at), from(&t.ap, at), from(&t.inverse, at));
        let (change, r) = (from_mut(&mut t.change, at), from_mut(&mut t.r, at));
        for i in (0..SIDE).step_by(SUMS) {
            for l in i..i + SUMS {
                change[l] += step * p[l];
                r[l] -= step * ap[l];
                sums[l - i] += r[l] * r[l] * inverse[l];
            }
        }
    }
    total(sums)
}

/// Writes r = −g − DᵀWD x of the surface x at the tile's pixels that are not at rest, and ap = 0.
#[inline(always)]
pub(super) fn residual_of_surface(t: &mut Tile, system: &PlateSystem<'_>, x: &[f32], corner: [isize; 2]) {
    t.differences.iter_mut().for_each(|d| d.fill(0.0));
    t.ap.fill(0.0);
    let w = system.width;
    let (mut here, mut in_window) = columns(corner[0], w);
    // The window's own ring has no differences, so that none reaches beyond it.
    if in_window.start == 0 {
        (here, in_window.start) = (here + 1, 1);
    }
    in_window.end = in_window.end.min(w - 1);
    for y in 0..SIDE {
        let Some(row) = row_of(corner[1], y, system.height).filter(|r| *r > 0 && *r + 1 < system.height) else {
            continue;
        };
        let [xx, yy, xy] = &mut t.differences;
        for (n, column) in in_window.clone().enumerate() {
            let (g, i) = (row * w + column, AHEAD + y * SIDE + here + n);
            xx[i] = t.xx[i] * (x[g - 1] - 2.0 * x[g] + x[g + 1]);
            yy[i] = t.yy[i] * (x[g - w] - 2.0 * x[g] + x[g + w]);
            xy[i] = t.xy[i] * (x[g] - x[g + 1] - x[g + w] + x[g + w + 1]);
        }
    }
    for y in 1..SIDE - 1 {
        let Some(row) = row_of(corner[1], y, system.height) else { continue };
        let rough = transposed(&t.differences, AHEAD + y * SIDE);
        let (here, in_window) = columns(corner[0], w);
        for (n, column) in in_window.enumerate() {
            let i = AHEAD + y * SIDE + here + n;
            t.r[i] = if t.inverse[i] > 0.0 { -system.g[row * w + column] - rough[here + n] } else { 0.0 };
        }
    }
}

/// Moves one row of the search direction.
#[inline(always)]
fn direction(t: &mut Tile, at: usize, beta: f32) {
    let (r, inverse, p) = (from(&t.r, at), from(&t.inverse, at), from_mut(&mut t.p, at));
    for i in 0..SIDE {
        p[i] = r[i] * inverse[i] + beta * p[i];
    }
}

/// Writes the weighted differences of a row: along x, along y, mixed.
#[inline(always)]
fn weighted_differences(
    [west, here, east]: [&[f32; SIDE]; 3],
    [north, south, south_east]: [&[f32; SIDE]; 3],
    [wxx, wyy, wxy]: [&[f32; SIDE]; 3],
    [xx, yy, xy]: [&mut [f32; SIDE]; 3],
) {
    for i in 0..SIDE {
        let c = here[i];
        xx[i] = wxx[i] * (west[i] - 2.0 * c + east[i]);
        yy[i] = wyy[i] * (north[i] - 2.0 * c + south[i]);
        xy[i] = wxy[i] * (c - east[i] - south[i] + south_east[i]);
    }
}

/// Returns the transposed differences of weighted differences, at the row that begins at a place.
#[inline(always)]
fn transposed([xx, yy, xy]: &[Vec<f32>; 3], at: usize) -> [f32; SIDE] {
    let (west, middle, east) = (from(xx, at - 1), from(xx, at), from(xx, at + 1));
    let (north, center, south) = (from(yy, at - SIDE), from(yy, at), from(yy, at + SIDE));
    let (own, left) = (from(xy, at), from(xy, at - 1));
    let (up, up_left) = (from(xy, at - SIDE), from(xy, at - SIDE - 1));
    let mut out = [0.0f32; SIDE];
    for i in 0..SIDE {
        let straight = west[i] - 2.0 * middle[i] + east[i] + north[i] - 2.0 * center[i] + south[i];
        out[i] = straight + own[i] - left[i] - up[i] + up_left[i];
    }
    out
}

/// Returns the sum of partial sums.
#[inline(always)]
fn total(sums: [f32; SUMS]) -> f64 {
    sums.iter().map(|s| f64::from(*s)).sum()
}
