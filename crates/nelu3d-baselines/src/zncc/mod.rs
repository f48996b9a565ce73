//! Zero-mean normalized cross-correlation (Mirdehghan, Chen & Kutulakos, "Optimal Structured Light à la Carte", CVPR
//! 2018): the column whose codeword, less its mean and divided by its norm, looks most like what a pixel saw. It needs
//! no white and no black: ambient light goes with the mean, albedo with the norm.
//!
//! With one pixel, all columns of the epipolar interval (or of the image) are compared. With a window, the correlations
//! of the pixels around, each weighted by its contrast, are summed at equal inverse depth before the best is chosen.
//!
//! The column is refined by Gauss–Newton on |p − a c(u) − b|² with the codeword interpolated (Catmull–Rom); scale and
//! offset are eliminated, and the same step gives the standard deviation. With a window, a plane in inverse depth is
//! then fitted to the refined pixels in it that belong together.

mod blur;
mod blurred;
mod codewords;
mod columns;
mod refine;
mod single;
mod window;
mod window_sums;

use nelu3d_scan::rig::PatternSet;

use crate::captured::Captured;
use crate::code::Code;
use crate::coordinates::{Coordinate, DecodedCoordinates};
use crate::error::DecodeError;
use crate::options::{Columns, DecodeOptions};
use crate::triangulate::{Geometry, line_of};
use blur::{blur_from_contrast, blur_from_misfit};
use codewords::SeenCodewords;
pub use codewords::{CodewordTable, centered, largest};
pub use refine::Refiner;
use single::single;
use window::WindowSearch;

/// Decodes all axes of a code.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
    opts: &DecodeOptions,
) -> Result<DecodedCoordinates, DecodeError> {
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let planes: Vec<(usize, usize)> =
            (0..captured.planes.len()).filter_map(|p| line_of(axis, captured, p).map(|l| (p, l))).collect();
        if planes.len() < 3 {
            return Err(DecodeError::Unsuited {
                set: set.name.clone(),
                method: "zncc",
                problem: format!("it has {} image(s) along one axis", planes.len()),
                remedy: "correlation needs three or more".into(),
            });
        }
        let seen = SeenCodewords::new(captured, &planes);
        let blur = opts.blur.unwrap_or_else(|| {
            if planes.len() > 3 {
                blur_from_misfit(&seen, captured, axis, &planes, geometry)
            } else {
                blur_from_contrast(captured, axis, &planes)
            }
        });
        tracing::info!(blur, "zncc");
        let table = CodewordTable::new(axis, &planes, blur);
        let window = opts.patch.unwrap_or(if planes.len() >= 6 || opts.columns == Columns::All { 1 } else { 9 });
        let (at, sigma) = if window > 1 {
            WindowSearch {
                seen: &seen,
                table: &table,
                axis,
                geometry,
                captured,
                min_score: opts.min_score,
                radius: window / 2,
            }
            .run(&mut status)
        } else {
            single(&seen, &table, axis, geometry, captured, opts, &mut status)
        };
        coordinates.push(Coordinate { axis: axis.axis, at, sigma });
    }
    Ok(DecodedCoordinates { coordinates, status })
}
