//! The print of a board as black shapes.

use nalgebra::{Matrix3, Vector3};

use super::outline::outlines;
use super::sheet::Shape;
use crate::board::BoardError;
use crate::board::layout::Layout;
use crate::pose::homography_4pt;

/// Returns what is black on a board, in its own coordinates as described (mm). Every marker is one shape, and so are all
/// squares together.
pub(super) fn shapes(layout: &Layout) -> Result<Vec<Shape>, BoardError> {
    let mut shapes = Vec::with_capacity(layout.markers.len() + 1);
    if let Some(s) = &layout.squares {
        let mm = |p: [usize; 2]| [p[0] as f64 * s.side_mm, p[1] as f64 * s.side_mm];
        let loops = outlines(s.columns, s.rows, |c, r| s.is_black(c, r));
        shapes.push(Shape { loops: loops.into_iter().map(|l| l.into_iter().map(mm).collect()).collect() });
    }
    let Some(dictionary) = &layout.dictionary else { return Ok(shapes) };
    let n = dictionary.bits() + 2;
    for m in &layout.markers {
        let side = n as f64;
        let unit = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
        let board_from_cells: Matrix3<f64> = homography_4pt(&unit, &m.corners_mm)
            .ok_or_else(|| BoardError::invalid(format!("the corners of marker {} lie on a line", m.id)))?;
        let mm = |p: [usize; 2]| {
            let q = board_from_cells * Vector3::new(p[0] as f64, p[1] as f64, 1.0);
            [q.x / q.z, q.y / q.z]
        };
        let is_black = |c: usize, r: usize| {
            c == 0 || r == 0 || c == n - 1 || r == n - 1 || dictionary.is_black(m.id, r - 1, c - 1)
        };
        let loops = outlines(n, n, is_black);
        shapes.push(Shape { loops: loops.into_iter().map(|l| l.into_iter().map(mm).collect()).collect() });
    }
    Ok(shapes)
}
