//! Whole pieces of a surface that are not explained: a wrong period of the code, or an object outside the volume.
//!
//! A pixel may be excused: a highlight, a mixed pixel, a corner full of interreflection. A whole piece of surface whose typical
//! codeword does not fit, or fits only with more light of unseen origin than there is between surfaces, is at a wrong depth.

use nelu3d_scan::Camera;

use super::filter::FilterSettings;
use super::refine::Refined;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Rejects the connected pieces of a depth map (camera z, mm) that are not explained.
pub(super) fn reject_unexplained_pieces(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    refined: &Refined,
    settings: &FilterSettings,
) {
    let (component, sizes) = Links::new(depth, camera, MAX_SLOPE).components(depth, camera.width);
    let mut pieces: Vec<Vec<usize>> = sizes.iter().map(|n| Vec::with_capacity(*n as usize)).collect();
    for (i, c) in component.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
        pieces[*c as usize].push(i);
    }
    for piece in pieces.iter().filter(|p| p.len() >= settings.min_component.max(1)) {
        let (chi2, unseen) = (median_of(&refined.chi2, piece), median_of(&refined.unseen, piece));
        tracing::debug!(pixels = piece.len(), chi2, unseen, z = depth[piece[piece.len() / 2]], "piece");
        if chi2 > settings.max_piece_chi2 || unseen > settings.max_piece_unseen {
            for &i in piece {
                (depth[i], status[i]) = (f32::NAN, PixelStatus::Ambiguous);
            }
        }
    }
}

fn median_of(map: &[f32], piece: &[usize]) -> f32 {
    let mut values: Vec<f32> = piece.iter().map(|i| map[*i]).collect();
    let mid = values.len() / 2;
    *values.select_nth_unstable_by(mid, f32::total_cmp).1
}
