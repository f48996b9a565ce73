//! Where in the projected image a board's corners are.

use nelu3d_scan::board::Corner;
use nelu3d_scan::pose::Homography;
use nelu3d_scan::rig::PatternSet;
use rayon::prelude::*;

use crate::captured::Captured;
use crate::code::Code;
use crate::error::DecodeError;
use crate::gray;
use nelu3d::surface::PixelStatus;

/// Fewest decoded pixels around a corner.
const MIN_PIXELS: usize = 30;

/// Most pixels that a homography is fitted to: more are skipped evenly.
const MAX_PIXELS: usize = 500;

/// Finds the projector pixel of every corner, from a local homography over the decoded pixels within `radius` (camera
/// px) of it; `None` where too few were decoded, or only on one side of the corner.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    corners: &[Corner],
    radius: usize,
) -> Result<Vec<Option<[f64; 2]>>, DecodeError> {
    let decoded = gray::decode(captured, code, set)?;
    let [x, y] = &decoded.coordinates[..] else { unreachable!("the set has a code along both axes") };
    let one = |corner: &Corner| -> Option<[f64; 2]> {
        let [cx, cy] = corner.px;
        let r = radius as f64;
        let range =
            |c: f64, n: usize| (c - r).ceil().max(0.0) as usize..((c + r).floor() + 1.0).clamp(0.0, n as f64) as usize;
        let (mut from, mut to) = (Vec::new(), Vec::new());
        let mut sides = [false; 4];
        for py in range(cy, captured.height) {
            for px in range(cx, captured.width) {
                let i = py * captured.width + px;
                if decoded.status[i] != PixelStatus::Valid || !x.at[i].is_finite() || !y.at[i].is_finite() {
                    continue;
                }
                // Relative to the corner, which keeps the numbers small.
                let (dx, dy) = (px as f64 - cx, py as f64 - cy);
                from.push([dx, dy]);
                to.push([f64::from(x.at[i]), f64::from(y.at[i])]);
                sides[usize::from(dx > 0.0)] = true;
                sides[2 + usize::from(dy > 0.0)] = true;
            }
        }
        if from.len() < MIN_PIXELS || sides != [true; 4] {
            return None;
        }
        let step = from.len().div_ceil(MAX_PIXELS);
        let thin = |v: &[[f64; 2]]| v.iter().copied().step_by(step).collect::<Vec<_>>();
        let at = Homography::robust(&thin(&from), &thin(&to))?.apply([0.0, 0.0]);
        at.iter().all(|v| v.is_finite()).then_some(at)
    };
    Ok(corners.par_iter().map(one).collect())
}
