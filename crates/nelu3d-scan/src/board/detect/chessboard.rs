//! Plain chessboards, with `calib-targets-chessboard`.

use std::collections::BTreeMap;

use calib_targets_chessboard::{ChessboardDetector, ChessboardParams, default_chess_config, detect_corners};

use super::gray::Decimated;
use super::pair::Pair;
use crate::board::BoardError;
use crate::board::layout::Squares;
use crate::pose::Homography;

/// Finds the inner corners of the whole board.
///
/// The library names corners by their place in whatever grid it saw. Here that grid must have the board's size (what
/// sticks out is cropped), and is turned so that the board's black squares are black and, among the turns that leave
/// the print unchanged, its x axis points furthest to the right.
pub(super) fn find(image: &Decimated, squares: &Squares) -> Result<Vec<Pair>, BoardError> {
    let corners = detect_corners(&image.view(), &default_chess_config());
    let detector =
        ChessboardDetector::new(ChessboardParams::default()).map_err(|e| BoardError::invalid(e.to_string()))?;
    let found = detector.detect(&corners);
    let found = found.ok_or_else(|| BoardError::not_found("no chessboard in the image"))?;
    let grid: BTreeMap<[i32; 2], [f64; 2]> = found
        .corners
        .iter()
        .map(|c| ([c.grid.u, c.grid.v], [f64::from(c.position.x), f64::from(c.position.y)]))
        .collect();

    let best = (0..4).filter_map(|turns| place(image, &grid, squares, turns)).max_by(|a, b| a.0.total_cmp(&b.0));
    let (_, pairs) = best.ok_or_else(|| {
        let extent = |k: usize| {
            let values = || grid.keys().map(move |g| g[k]);
            values().max().unwrap_or(0) - values().min().unwrap_or(0) + 1
        };
        BoardError::not_found(format!(
            "a grid of {} x {} inner corners was seen, the board has {} x {} (all must be visible, the top-left square \
             being black)",
            extent(0),
            extent(1),
            squares.columns - 1,
            squares.rows - 1
        ))
    })?;
    Ok(pairs)
}

/// Takes the grid for the board turned by `turns` quarters, if it has the board's size and colors: how far to the right
/// the board's x axis points, and the corners.
fn place(
    image: &Decimated,
    grid: &BTreeMap<[i32; 2], [f64; 2]>,
    squares: &Squares,
    turns: usize,
) -> Option<(f64, Vec<Pair>)> {
    let turn = |[u, v]: [i32; 2]| [[u, v], [v, -u], [-u, -v], [-v, u]][turns];
    let (columns, rows) = (squares.columns as i32 - 1, squares.rows as i32 - 1);
    let turned: Vec<([i32; 2], [f64; 2])> = grid.iter().map(|(g, p)| (turn(*g), *p)).collect();
    let [u0, v0] = densest(&turned, [columns, rows])?;
    let side = squares.side_mm;
    let inside: Vec<([i32; 2], [f64; 2])> = turned
        .iter()
        .map(|(g, p)| ([g[0] - u0 + 1, g[1] - v0 + 1], *p))
        .filter(|(g, _)| (1..=columns).contains(&g[0]) && (1..=rows).contains(&g[1]))
        .collect();
    // A board partly seen could lie anywhere: its outermost rows and columns must be there.
    let touches = |k: usize, at: i32| inside.iter().any(|(g, _)| g[k] == at);
    if !(touches(0, 1) && touches(0, columns) && touches(1, 1) && touches(1, rows)) {
        return None;
    }
    let pairs: Vec<Pair> = inside.iter().map(|(g, p)| ([f64::from(g[0]) * side, f64::from(g[1]) * side], *p)).collect();
    let (from, to): (Vec<_>, Vec<_>) = pairs.iter().copied().unzip();
    let h = Homography::robust(&from, &to)?;
    if contrast(image, squares, &h) <= 0.0 {
        return None;
    }
    let (a, b) = (h.apply([0.0, 0.0]), h.apply([squares.columns as f64 * side, 0.0]));
    let rightward = (b[0] - a[0]) / (b[0] - a[0]).hypot(b[1] - a[1]);
    Some((rightward, pairs.into_iter().map(|(b, p)| (b, image.full(p))).collect()))
}

/// Returns the top-left of the window of this size that holds most corners; `None` when the grid is smaller than the
/// window.
fn densest(grid: &[([i32; 2], [f64; 2])], size: [i32; 2]) -> Option<[i32; 2]> {
    let range = |k: usize| {
        let lo = grid.iter().map(|g| g.0[k]).min()?;
        let hi = grid.iter().map(|g| g.0[k]).max()?;
        (hi - lo + 1 >= size[k]).then_some(lo..=hi + 1 - size[k])
    };
    let (us, vs) = (range(0)?, range(1)?);
    let count = |u: i32, v: i32| {
        grid.iter().filter(|(g, _)| (u..u + size[0]).contains(&g[0]) && (v..v + size[1]).contains(&g[1])).count()
    };
    us.flat_map(|u| vs.clone().map(move |v| [u, v])).max_by_key(|[u, v]| count(*u, *v))
}

/// Returns how much brighter the board's white squares are than its black ones, in 8-bit steps.
fn contrast(image: &Decimated, squares: &Squares, h: &Homography) -> f64 {
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for row in 0..squares.rows {
        for column in 0..squares.columns {
            let center = h.apply([(column as f64 + 0.5) * squares.side_mm, (row as f64 + 0.5) * squares.side_mm]);
            if let Some(v) = image.at(center) {
                let k = usize::from(squares.is_black(column, row));
                sums[k] += f64::from(v);
                counts[k] += 1.0;
            }
        }
    }
    sums[0] / f64::max(counts[0], 1.0) - sums[1] / f64::max(counts[1], 1.0)
}
