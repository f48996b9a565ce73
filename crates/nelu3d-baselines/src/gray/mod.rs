//! Binary codes: Gray, binary, XOR or any other, whatever table the projected images spell.
//!
//! A bit is the sign of pattern − inverse, or of pattern − ½ (halfway between white and black) where there are no
//! inverses. A bit that the noise could have turned is uncertain. One uncertain bit is fine where both of its values
//! name neighboring columns, which in a Gray code is the edge between them; with anything else the pixel is rejected.
//!
//! Columns are refined to sub-pixel: where neighboring pixels along the camera's row (or column, for a projector turned
//! by a right angle) decode to different columns, the bit that tells them apart changes sign between them, and the zero
//! crossing of the difference, found by linear interpolation, lies where the light comes from the border of two
//! projector columns. Between two such crossings the column is interpolated. Pixels before the first and behind the
//! last crossing of a run keep the center of their column, with the standard deviation of a uniform error over its
//! width.

mod bit;
mod columns;
pub mod refine;
mod table;

use nelu3d::surface::PixelStatus;
use nelu3d_scan::rig::PatternSet;

use crate::captured::Captured;
use crate::code::Code;
use crate::coordinates::{Coordinate, DecodedCoordinates};
use crate::error::DecodeError;
use bit::Bit;
use columns::columns;
use refine::refine;
pub use table::GrayTable;

/// Decodes all axes of a code.
pub(crate) fn decode(captured: &Captured, code: &Code, set: &PatternSet) -> Result<DecodedCoordinates, DecodeError> {
    if code.colored {
        return Err(DecodeError::Unsuited {
            set: set.name.clone(),
            method: "gray",
            problem: "its images are colored".into(),
            remedy: "use setting `method` zncc".into(),
        });
    }
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let table = GrayTable::new(axis, set)?;
        let bits: Vec<Bit<'_>> = axis.lines.iter().map(|l| Bit::new(captured, l.image)).collect();
        let columns = columns(captured, &table, &bits);
        for (l, c) in status.iter_mut().zip(&columns) {
            if *l == PixelStatus::Valid && c[0] > c[1] {
                *l = PixelStatus::Ambiguous;
            }
        }
        let (at, sigma) = refine(captured, &table, &bits, &columns);
        coordinates.push(Coordinate { axis: axis.axis, at, sigma });
    }
    Ok(DecodedCoordinates { coordinates, status })
}
