//! In which frame the field is fitted, and how finely: the candidates are compared at positions that none has seen.

use nalgebra::{Point3, Vector3};
use nelu3d_field::device::Device;

use super::candidate::{Candidate, FitContext, MAX_SHORTFALL_DB};
use super::error::CalibrationError;
use super::light::LightCenter;
use super::options::{CalibrationOptions, FormKind, FrameKind};
use super::placed_sweep::PlacedSweep;
use super::pose_refinement::{RefinedPoses, refine_poses};
use crate::color_field::fit::Smoothness;
use crate::color_field::frame::{Center, FieldFrame};
use crate::progress::Progress;

/// Cells per pixel across where one is not enough.
const FINE_CELLS_PER_PIXEL: usize = 2;
/// Shortfall of the held-out PSNR against what the noise allows, beyond which finer cells are tried, dB. Boards held by
/// hand may be predicted well enough and yet far better: five of them, 2.9 dB below the noise, were at the noise with
/// finer cells, and their scans had two thirds of the error.
const FINER_FROM_DB: f64 = 1.0;
/// Held-out PSNR above which a center of the light is not chance, dB.
const FAIR_DB: f64 = 16.0;
/// Number of positions up to which each of them is held out in turn.
const IN_TURN: usize = 8;

/// Fits the field without the held-out positions, in the light's frame if there is one, finer if one cell per pixel is
/// too coarse (codes with edges are finer than pixels, and the positions see them between each other's pixels), in the
/// camera's frame if the light's does not hold; returns the candidate that predicts the held-out positions best. In the
/// light's frame the poses of a few boards are refined first, which moves the boards of `placed`.
///
/// # Errors
///
/// An image cannot be read, no sample is usable, or the caller stopped the work.
pub(super) fn fit_best_frame(
    placed: &mut PlacedSweep<'_>,
    light: Option<&LightCenter>,
    opts: &CalibrationOptions,
    device: &Device,
    progress: &Progress,
) -> Result<(Candidate, Option<RefinedPoses>), CalibrationError> {
    let folds = folds(placed.n_positions(), opts.hold_out, opts.form);
    let is_within = |c: &Candidate, db: f64| c.quality.psnr_db > c.quality.ceiling_db - db;
    let is_good = |c: &Candidate| is_within(c, MAX_SHORTFALL_DB);
    let (mut tried, mut refined): (Vec<Candidate>, _) = (Vec::new(), None);
    if let Some(light) = light {
        let fit = |placed: &PlacedSweep<'_>, cells_per_pixel: usize, known: Option<&Smoothness>| {
            let frame = FieldFrame::new(light.origin, light.along, light.kappa, Vector3::x());
            let context = FitContext { placed, opts, device, progress };
            Candidate::fit(&context, frame, Center::Light, cells_per_pixel, &folds, known)
        };
        let mut first = fit(placed, 1, None)?;
        tracing::debug!(psnr = first.quality.psnr_db, ceiling = first.quality.ceiling_db, "field in the light's frame");
        refined = refine_poses(placed, &mut first, light.line.is_some(), |placed, known| fit(placed, 1, Some(known)))?;
        tried.push(first);
        // Finer is no finer where the number of coefficients is the limit.
        if !is_within(&tried[0], FINER_FROM_DB) && !tried[0].is_limited {
            tried.iter_mut().for_each(Candidate::drop_bins);
            tried.push(fit(placed, FINE_CELLS_PER_PIXEL, None)?);
        }
    }
    let finer_is_better = tried.len() == 2 && tried[1].quality.psnr_db > tried[0].quality.psnr_db + MAX_SHORTFALL_DB;
    let light_holds = tried.iter().any(is_good) || finer_is_better;
    // A few boards, placed by hand, are too far apart for the camera's frame wherever the light's holds at all.
    let camera_may_hold = placed.n_positions() > IN_TURN || !tried.iter().any(|c| c.quality.psnr_db > FAIR_DB);
    if tried.is_empty() || (opts.frame == FrameKind::Auto && !light_holds && camera_may_hold) {
        tried.iter_mut().for_each(Candidate::drop_bins);
        let middle = Point3::from(placed.mean_point());
        let frame = FieldFrame::around(Point3::origin(), middle, Vector3::x());
        let context = FitContext { placed, opts, device, progress };
        tried.push(Candidate::fit(&context, frame, Center::Camera, 1, &folds, None)?);
    }
    if progress.cancelled() {
        return Err(CalibrationError::Cancelled);
    }
    Ok((best_of(tried, placed.n_positions() <= IN_TURN), refined))
}

/// Returns the best of at least one candidate: of those in the light's frame, the coarser one, unless the finer one has
/// the smaller errors in depth at the held-out positions and, with `few` boards, predicts their codewords better, too;
/// of that and the one in the camera's frame, the one that predicts codewords best.
///
/// Cells finer than pixels follow the edges of a code better, which decibels reward, and its noise, which depth does
/// not forgive: four to eight boards of Gray code, held by hand, have 1 dB more with them and 1.5 to 1.8 times the
/// error. Depth alone does not tell either where few boards leave cells to one sample: it is error over slope, and
/// noise that is followed has large slopes. Four boards under three random patterns have 1 dB less and half of the
/// depth error with finer cells, and scan worse; thirty boards of Gray code have 0.5 dB less, and scan better.
fn best_of(tried: Vec<Candidate>, few: bool) -> Candidate {
    /// Gain of finer cells below which they are not worth the rays that no sample of a few boards supports.
    const MIN_GAIN_DB: f64 = 0.5;
    let is_better = |finer: &Candidate, coarser: &Candidate| {
        let (finer, coarser) = (&finer.quality, &coarser.quality);
        tracing::debug!(finer = ?(finer.psnr_db, finer.depth_mm), coarser = ?(coarser.psnr_db, coarser.depth_mm), "cells");
        finer.depth_mm < coarser.depth_mm && (!few || finer.psnr_db > coarser.psnr_db + MIN_GAIN_DB)
    };
    let (light, camera): (Vec<_>, Vec<_>) = tried.into_iter().partition(|c| c.center == Center::Light);
    let light = light.into_iter().reduce(|best, next| if is_better(&next, &best) { next } else { best });
    let best = light.into_iter().chain(camera).max_by(|a, b| a.quality.psnr_db.total_cmp(&b.quality.psnr_db));
    best.expect("at least one frame was tried")
}

/// The positions that are held out together: every one in turn where there are few, so that the measure does not rest
/// on one of them; else an even selection at once. Networks take too long to be trained that often.
fn folds(n: usize, stride: usize, form: FormKind) -> Vec<Vec<usize>> {
    if n <= IN_TURN && form == FormKind::Grid {
        return (0..n).map(|p| vec![p]).collect();
    }
    vec![held_out_positions(n, stride)]
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
pub(super) fn reason(center: Center, light: Option<&LightCenter>, opts: &CalibrationOptions) -> String {
    match (center, light, opts.frame) {
        _ if opts.form == FormKind::Published => "camera: form `published` has no other".into(),
        (Center::Light, Some(LightCenter { line: Some(line), .. }), _) => format!(
            "light: codewords are constant along its rays; they vary along one axis, which tells its center only up to a line \
             along ({:.2}, {:.2}, {:.2})",
            line.x, line.y, line.z
        ),
        (Center::Light, ..) => "light: codewords are constant along its rays".into(),
        (Center::Camera, _, FrameKind::Camera) => "camera: as asked".into(),
        (Center::Camera, Some(_), _) => "camera: it predicts held-out positions better than the light's frame".into(),
        (Center::Camera, None, _) => "camera: no center of the light explains the sweep".into(),
    }
}

/// Why a field stays more than 3 dB below what noise and pixels allow, in words; `None` if it does not.
pub(super) fn shortfall(best: &Candidate, light: Option<&LightCenter>, form: FormKind) -> Option<String> {
    let q = &best.quality;
    let allowed = best.allowed_db.map_or(q.ceiling_db, |db| db.min(q.ceiling_db));
    tracing::debug!(psnr = q.psnr_db, ceiling = q.ceiling_db, allowed, "held out");
    if q.psnr_db.is_nan() {
        let reason = "no held-out position could be compared: no two boards share a ray of light; place boards so that \
                      they overlap as the light sees them";
        return Some(reason.into());
    }
    if q.psnr_db >= allowed - MAX_SHORTFALL_DB {
        return None;
    }
    let mut db: Vec<f64> = best.by_position.iter().map(|p| p.1).collect();
    db.sort_by(f64::total_cmp);
    let worst = best.by_position.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let why = match worst {
        Some((name, of_worst)) if db.len() > 2 && *of_worst < db[db.len() / 2] - 2.0 * MAX_SHORTFALL_DB => format!(
            "position {name} does not fit the others ({of_worst:.1} dB): check it, or leave it out"
        ),
        _ if form == FormKind::Published => {
            "form `published` is known at the boards only, since its finest cells are far smaller than the distance between \
             them: add positions, or lower the finest level"
                .into()
        }
        _ if best.center == Center::Camera && light.is_some() => {
            "the center of the light that was found does not predict the sweep, and the camera's frame needs boards that are \
             closer to each other: add positions between these"
                .into()
        }
        _ if best.center == Center::Camera => "no center of the light was found: add positions".into(),
        _ if best.is_limited => {
            "the code has edges finer than the field's cells: calibrate a set of fewer images, or use patterns with wider \
             stripes"
                .into()
        }
        _ => "the patterns are finer than the camera's pixels, or the boards' poses are not exact".into(),
    };
    Some(format!(
        "the field predicts positions that it has not seen to {:.1} dB, and noise alone allows {:.1}, with the edges of the \
         code {allowed:.1}: {why}",
        q.psnr_db, q.ceiling_db
    ))
}
