//! The edges that meet in each corner of a board.

use crate::board::Marker;
use crate::board::layout::{Layout, Squares};

/// A corner and the two lines that cross in it.
#[derive(Clone, Debug)]
pub(super) struct CornerSpec {
    pub(super) board_mm: [f64; 2],
    /// Arms of the first and of the second line. A marker's corner ends both (one arm each), a chessboard's lines go
    /// through (two arms each).
    pub(super) lines: [Vec<Arm>; 2],
}

/// A straight edge between black and white that starts at a corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arm {
    /// Unit vector along it, on the board.
    pub(super) dir: [f64; 2],
    /// Unit vector across it, toward the white side.
    pub(super) bright: [f64; 2],
    /// How far it goes, mm.
    pub(super) length_mm: f64,
    /// How far nothing else is printed on both sides of it, mm.
    pub(super) clear_mm: f64,
    /// How far the board's outline is on the white side, where it is parallel to the edge, mm; infinite where it is not.
    /// It may be drawn within the board, so that nothing may end there.
    pub(super) outline_mm: f64,
    /// Whether a marker's border runs along it there, on the white side: it is as dark as the dark side, and begins at
    /// the corner no nearer than it is to the edge.
    pub(super) has_marker: bool,
    /// Whether another edge crosses its far end, too.
    pub(super) ends: bool,
}

/// Returns the corners of a board with the outline (x0, y0, x1, y1), mm: inner corners of its squares row by row, or
/// those of its markers.
pub(super) fn corners(layout: &Layout, outline_mm: [f64; 4]) -> Vec<CornerSpec> {
    match &layout.squares {
        Some(squares) => {
            let clear = layout.markers.first().map_or(0.5 * squares.side_mm, |m| m.corners_mm[0][0] % squares.side_mm);
            inner_corners(squares, clear.min(0.5 * squares.side_mm), !layout.markers.is_empty())
        }
        None => {
            let bits = layout.dictionary.as_ref().map_or(4, |d| d.bits());
            let of = |i: usize| marker_corners(&layout.markers, i, bits, outline_mm);
            (0..layout.markers.len()).flat_map(of).collect()
        }
    }
}

fn inner_corners(squares: &Squares, clear_mm: f64, has_marker: bool) -> Vec<CornerSpec> {
    let side = squares.side_mm;
    let arm = |dir: [f64; 2], to: [f64; 2], white: bool| Arm {
        dir,
        bright: if white { to } else { [-to[0], -to[1]] },
        // Half of the side: the other half is the neighbor's.
        length_mm: 0.5 * side,
        clear_mm,
        outline_mm: f64::INFINITY,
        has_marker,
        ends: false,
    };
    let mut corners = Vec::new();
    for row in 1..squares.rows {
        for column in 1..squares.columns {
            // The square to the bottom right of the corner; its neighbors alternate.
            let white = !squares.is_black(column, row);
            let along_x = vec![arm([1.0, 0.0], [0.0, 1.0], white), arm([-1.0, 0.0], [0.0, 1.0], !white)];
            let along_y = vec![arm([0.0, 1.0], [1.0, 0.0], white), arm([0.0, -1.0], [1.0, 0.0], !white)];
            corners.push(CornerSpec { board_mm: [column as f64 * side, row as f64 * side], lines: [along_x, along_y] });
        }
    }
    corners
}

fn marker_corners(markers: &[Marker], which: usize, bits: usize, outline_mm: [f64; 4]) -> Vec<CornerSpec> {
    let c = &markers[which].corners_mm;
    let length = |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
    let shortest = (0..4).map(|i| length(c[i], c[(i + 1) % 4])).fold(f64::INFINITY, f64::min);
    // Inside, the border is one bit wide; outside, the next marker may be closer than that.
    let bit = shortest / (bits + 2) as f64;
    let others = markers.iter().enumerate().filter(|(i, _)| *i != which);
    let clear_mm = others.map(|(_, m)| distance(c, &m.corners_mm)).fold(bit, f64::min);
    let arm = |from: [f64; 2], to: [f64; 2], forward: bool| {
        let l = length(from, to);
        let dir = [(to[0] - from[0]) / l, (to[1] - from[1]) / l];
        // Corners go clockwise (x right, y down): outside is to the left of the way on, to the right of the way back.
        let bright = if forward { [dir[1], -dir[0]] } else { [-dir[1], dir[0]] };
        let outline_mm = to_outline(from, to, bright, outline_mm);
        vec![Arm { dir, bright, length_mm: l, clear_mm, outline_mm, has_marker: false, ends: true }]
    };
    let spec = |i: usize| CornerSpec {
        board_mm: c[i],
        lines: [arm(c[i], c[(i + 1) % 4], true), arm(c[i], c[(i + 3) % 4], false)],
    };
    (0..4).map(spec).collect()
}

/// Returns how far the outline (x0, y0, x1, y1) is from an edge on its side `bright`; infinite where it is not parallel
/// to it, or not on that side.
fn to_outline(from: [f64; 2], to: [f64; 2], bright: [f64; 2], [x0, y0, x1, y1]: [f64; 4]) -> f64 {
    let (lo, hi) = ([x0, y0], [x1, y1]);
    let Some(axis) = (0..2).find(|axis| bright[*axis].abs() > 1.0 - 1e-6) else { return f64::INFINITY };
    let room = |p: [f64; 2]| if bright[axis] > 0.0 { hi[axis] - p[axis] } else { p[axis] - lo[axis] };
    let least = room(from).min(room(to));
    if least > 0.0 { least } else { f64::INFINITY }
}

/// Returns the distance between two convex quadrilaterals that do not overlap: one end of it is a corner.
fn distance(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    let to_segment = |p: [f64; 2], s: [f64; 2], e: [f64; 2]| {
        let d = [e[0] - s[0], e[1] - s[1]];
        let t = ((p[0] - s[0]) * d[0] + (p[1] - s[1]) * d[1]) / (d[0] * d[0] + d[1] * d[1]);
        let t = t.clamp(0.0, 1.0);
        (s[0] + t * d[0] - p[0]).hypot(s[1] + t * d[1] - p[1])
    };
    let one_way = |a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]| {
        a.iter().flat_map(|p| (0..4).map(move |i| to_segment(*p, b[i], b[(i + 1) % 4]))).fold(f64::INFINITY, f64::min)
    };
    one_way(a, b).min(one_way(b, a))
}
