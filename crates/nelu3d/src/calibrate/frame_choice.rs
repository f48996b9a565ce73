//! In which frame the field is fitted, and how finely: the candidates are compared at positions that none has seen.

use nalgebra::{Point3, Vector3};

use super::candidate::{Candidate, FitContext};
use super::error::CalibrationError;
use super::light::LightCenter;
use super::options::FrameKind;
use crate::color_field::frame::{Center, FieldFrame};

/// Cells per pixel across where one is not enough.
const FINE_CELLS_PER_PIXEL: usize = 2;
/// Shortfall of the held-out PSNR against what the noise allows, beyond which another candidate is tried, dB.
const MAX_SHORTFALL_DB: f64 = 3.0;

/// Fits the field without the held-out positions, in the light's frame if there is one, finer if one cell per pixel is too
/// coarse (codes with edges are finer than pixels, and the positions see them between each other's pixels), in the
/// camera's frame if the light's does not hold; returns the candidate that predicts the held-out positions best.
pub(super) fn fit_best_frame(
    fit: &FitContext<'_, '_>,
    light: Option<&LightCenter>,
) -> Result<Candidate, CalibrationError> {
    let (opts, progress) = (fit.opts, fit.progress);
    let held = held_out_positions(fit.placed.n_positions(), opts.hold_out);
    let is_good = |c: &Candidate| c.quality.psnr_db > c.quality.ceiling_db - MAX_SHORTFALL_DB;
    let mut tried: Vec<Candidate> = Vec::new();
    if let Some(light) = light {
        let frame = || FieldFrame::new(light.origin, light.along, light.kappa, Vector3::x());
        tried.push(Candidate::fit(fit, frame(), Center::Light, 1, &held)?);
        let q = &tried[0].quality;
        tracing::debug!(psnr = q.psnr_db, ceiling = q.ceiling_db, "field in the light's frame");
        if !tried.iter().any(is_good) {
            tried.iter_mut().for_each(Candidate::drop_bins);
            tried.push(Candidate::fit(fit, frame(), Center::Light, FINE_CELLS_PER_PIXEL, &held)?);
        }
    }
    let finer_is_better = tried.len() == 2 && tried[1].quality.psnr_db > tried[0].quality.psnr_db + MAX_SHORTFALL_DB;
    let light_holds = tried.iter().any(is_good) || finer_is_better;
    if tried.is_empty() || (opts.frame == FrameKind::Auto && !light_holds) {
        tried.iter_mut().for_each(Candidate::drop_bins);
        let middle = Point3::from(fit.placed.mean_point());
        let frame = FieldFrame::around(Point3::origin(), middle, Vector3::x());
        tried.push(Candidate::fit(fit, frame, Center::Camera, 1, &held)?);
    }
    if progress.cancelled() {
        return Err(CalibrationError::Cancelled);
    }
    let best = tried.into_iter().max_by(|a, b| a.quality.psnr_db.total_cmp(&b.quality.psnr_db));
    Ok(best.expect("at least one frame was tried"))
}

/// Every `stride`th of `n` positions, from the middle of the first stride on, so that held-out positions lie between
/// others; at least one.
fn held_out_positions(n: usize, stride: usize) -> Vec<usize> {
    let stride = stride.max(2);
    let mut held: Vec<usize> = (0..n).filter(|p| p % stride == stride / 2).collect();
    held.retain(|p| *p > 0 && p + 1 < n);
    if held.is_empty() {
        held.push(n / 2);
    }
    held
}

/// Why the field's frame is centered where it is, in words.
pub(super) fn reason(center: Center, light_was_found: bool, asked: FrameKind) -> &'static str {
    match (center, light_was_found, asked) {
        (Center::Light, ..) => "light: codewords are constant along its rays",
        (Center::Camera, _, FrameKind::Camera) => "camera: as asked",
        (Center::Camera, true, _) => "camera: it predicts held-out positions better than the light's frame",
        (Center::Camera, false, _) => "camera: no center of the light explains the sweep",
    }
}
