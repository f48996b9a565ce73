//! Decoding pixel by pixel.

use nelu3d::surface::PixelStatus;
use nelu3d_scan::pattern::{Axis, DecodedColumn};
use rayon::prelude::*;

use super::captured::Captured;
use super::coordinates::Coordinate;

/// Decodes every valid pixel along one axis and notes why the others have no coordinate.
///
/// `interval(i)` is where pixel i may be lit from, projector px, and `decode(i, sigma, interval)` decodes it, `sigma`
/// being the standard deviation of its normalized intensities.
pub(crate) fn decode_pixels(
    captured: &Captured,
    axis: Axis,
    status: &mut [PixelStatus],
    interval: impl Fn(usize) -> Option<[f32; 2]> + Sync,
    decode: impl Fn(usize, f32, [f32; 2]) -> Option<DecodedColumn> + Sync,
) -> Coordinate {
    let one = |(i, status): (usize, &mut PixelStatus)| -> (f32, f32) {
        if *status != PixelStatus::Valid {
            return (f32::NAN, f32::NAN);
        }
        let Some(within) = interval(i) else {
            *status = PixelStatus::OutsideVolume;
            return (f32::NAN, f32::NAN);
        };
        match decode(i, captured.variance(i, 0.5).sqrt(), within) {
            Some(found) if found.is_reliable() => (found.column, found.sigma),
            _ => {
                *status = PixelStatus::Ambiguous;
                (f32::NAN, f32::NAN)
            }
        }
    };
    let found: Vec<(f32, f32)> = status.par_iter_mut().enumerate().map(one).collect();
    let (at, sigma) = found.into_iter().unzip();
    Coordinate { axis, at, sigma }
}
