//! Which columns a pixel is compared with.

use crate::code::AxisCode;
use crate::options::Columns;
use crate::triangulate::Geometry;

/// Returns the first and last column that pixel `i` is compared with; `None` where the light does not reach its range.
pub(super) fn columns(geometry: &Geometry<'_>, axis: &AxisCode, search: Columns, i: usize) -> Option<(usize, usize)> {
    let last = axis.len() - 1;
    match search {
        Columns::All => Some((0, last)),
        Columns::Epipolar => {
            let [low, high] = geometry.interval(i, axis)?;
            Some((low.max(0.0) as usize, (high.max(0.0).ceil() as usize).min(last)))
        }
    }
}
