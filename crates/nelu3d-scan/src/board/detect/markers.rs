//! ArUco markers anywhere in the image: dark quadrilaterals, read with `calib-targets-aruco`.

use calib_targets_aruco::{MarkerCell, Matcher, ScanDecodeConfig, scan_decode_markers_in_cells};
use nalgebra::Point2;

use super::gray::Decimated;
use super::pair::Pair;
use super::quads;
use crate::board::{BoardError, Dictionary, Marker};

/// Fraction of the bits a dictionary can correct that may be wrong: OpenCV's `errorCorrectionRate`.
const CORRECTION_RATE: f64 = 0.6;

pub(super) fn matcher(dictionary: &Dictionary) -> Matcher {
    let correctable = f64::from(dictionary.codes().max_correction_bits());
    Matcher::new(dictionary.codes(), (CORRECTION_RATE * correctable) as u8)
}

/// Finds the corners of the board's markers that are seen.
pub(super) fn find(image: &Decimated, matcher: &Matcher, markers: &[Marker]) -> Result<Vec<Pair>, BoardError> {
    let quads = quads::find(image);
    let config = ScanDecodeConfig::default().with_inset_frac(0.02).with_dedup_by_id(false);
    let mut best: Vec<Option<(f32, [[f64; 2]; 4])>> = vec![None; markers.len()];
    for quad in &quads {
        let cell = MarkerCell::new(Default::default(), quad.map(|p| Point2::new(p[0] as f32, p[1] as f32)));
        for found in scan_decode_markers_in_cells(&image.view(), &[cell], 64.0, &config, matcher) {
            let Some(i) = markers.iter().position(|m| m.id == found.id).filter(|_| !found.inverted) else { continue };
            if best[i].is_none_or(|(score, _)| found.score > score) {
                // The print is seen turned clockwise by `rotation` quarters.
                let turned = std::array::from_fn(|k| quad[(k + found.rotation as usize) % 4]);
                best[i] = Some((found.score, turned));
            }
        }
    }
    let mut pairs = Vec::new();
    for (m, quad) in markers.iter().zip(&best) {
        let Some((_, quad)) = quad else { continue };
        pairs.extend(m.corners_mm.iter().zip(quad).map(|(b, p)| (*b, image.full(*p))));
    }
    if pairs.is_empty() {
        let n = quads.len();
        return Err(BoardError::not_found(format!("{n} dark quadrilaterals in the image, none is one of its markers")));
    }
    Ok(pairs)
}
