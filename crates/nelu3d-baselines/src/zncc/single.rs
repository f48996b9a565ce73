//! Every pixel by itself.

use nelu3d::surface::PixelStatus;
use rayon::prelude::*;

use super::codewords::{CodewordTable, SeenCodewords, centered, largest};
use super::columns::columns;
use super::refine::{Refiner, model_variance};
use crate::captured::Captured;
use crate::code::AxisCode;
use crate::options::DecodeOptions;
use crate::triangulate::Geometry;

/// Finds the best column of every pixel by itself.
pub(super) fn single(
    seen: &SeenCodewords,
    table: &CodewordTable,
    axis: &AxisCode,
    geometry: &Geometry<'_>,
    captured: &Captured,
    opts: &DecodeOptions,
    status: &mut [PixelStatus],
) -> (Vec<f32>, Vec<f32>) {
    let k = seen.k;
    let one = |(code, scores, refiner): &mut (Vec<f32>, Vec<f32>, Refiner), (i, status): (usize, &mut PixelStatus)| {
        let mut none = |why| {
            *status = why;
            (f32::NAN, f32::NAN)
        };
        if captured.status[i] != PixelStatus::Valid {
            return none(captured.status[i]);
        }
        let Some((low, high)) = columns(geometry, axis, opts.columns, i) else {
            return none(PixelStatus::OutsideVolume);
        };
        let norm = centered(seen.at(i), code);
        table.correlate(code, low, high, scores);
        let (at, best) = largest(scores);
        if best < opts.min_score * norm || norm <= 0.0 {
            return none(PixelStatus::Ambiguous);
        }
        let noise = captured.variance(i, 0.5) + model_variance(k);
        match refiner.refine(table, seen.at(i), (low + at) as f32, noise) {
            Some(found) => found,
            None => none(PixelStatus::Ambiguous),
        }
    };
    let found: Vec<(f32, f32)> =
        status.par_iter_mut().enumerate().map_init(|| (vec![0.0; k], Vec::new(), Refiner::new(k)), one).collect();
    found.into_iter().unzip()
}
