//! The camera's intrinsics from images of a board whose poses are not known: Zhang's method (2000) with OpenCV's
//! distortion of 0, 4, 5, or 8 coefficients.
//!
//! [`calibrate_intrinsics`] is the path: a start in closed form, a bundle adjustment of camera and poses, the number of
//! coefficients and the board's bend as images that were left out support them, standard deviations, and a judgment.
//! What the images leave open is an error that says so, not a number. [`find_boards`] finds the corners before that,
//! twice: the second time with the camera of the first, under which corners lie to a smaller part of a pixel.

mod bundle;
mod choice;
mod error;
mod images;
mod lens;
mod options;
mod parameters;
mod report;
mod start;
mod view;

pub use error::IntrinsicsError;
pub use images::{GrayImage, find_boards};
pub use lens::LensModel;
pub use options::{IntrinsicsOptions, StageStep};
pub use report::{Intrinsics, IntrinsicsReport, MAP, ModelReport, ViewReport};
pub use view::View;

use choice::{Candidate, best_start, candidate};
use parameters::{Middle, Parameters, Shared};

/// Fewest images; fewer leave the focal length open whatever they show.
const MIN_VIEWS: usize = 3;
/// Fewest corners of an image that counts.
const MIN_CORNERS: usize = 6;
/// Largest standard deviation of the focal length over itself that is a result: half a percent of every depth.
const MAX_FOCAL_SIGMA: f64 = 0.005;
/// Largest standard deviation of the principal point over the picture's width that is a result.
const MAX_CENTER_SIGMA: f64 = 0.01;

/// Calibrates a camera of so many columns and rows of pixels.
///
/// # Errors
///
/// Too few views; corners that no camera explains; or views that leave the focal length or the principal point open, as
/// boards that all face the camera do.
pub fn calibrate_intrinsics(
    views: &[View],
    size: [usize; 2],
    options: &IntrinsicsOptions,
) -> Result<Intrinsics, IntrinsicsError> {
    let usable: Vec<&View> = views.iter().filter(|v| v.corners.len() >= MIN_CORNERS).collect();
    let few = |usable: usize| {
        let short = views.iter().filter(|v| v.corners.len() < MIN_CORNERS);
        let reasons = short.map(|v| (v.name.clone(), format!("{} corners", v.corners.len()))).collect();
        IntrinsicsError::TooFewViews { usable, total: views.len(), needed: MIN_VIEWS, reasons }
    };
    if usable.len() < MIN_VIEWS {
        return Err(few(usable.len()));
    }
    let no_solution = || IntrinsicsError::NoSolution { views: usable.len() };
    let middle = middle(&usable);
    let start = best_start(&usable, middle, start::cameras(&usable, size)).ok_or_else(no_solution)?;
    let (chosen, tried) = choose(&usable, middle, &start, options).ok_or_else(no_solution)?;
    let data = bundle::Data { views: &usable, middle, stage: options.stage };
    judged(&data, &chosen, tried, options.keep_uncertain)
}

/// Returns the middle of all corners on the board, and half of their extent.
fn middle(views: &[&View]) -> Middle {
    let all = || views.iter().flat_map(|v| &v.corners).map(|c| c.board_mm);
    let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for p in all() {
        for k in 0..2 {
            (lo[k], hi[k]) = (lo[k].min(p[k]), hi[k].max(p[k]));
        }
    }
    let radius = 0.5 * (hi[0] - lo[0]).max(hi[1] - lo[1]).max(1e-9);
    Middle { at: [0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1])], radius }
}

/// Tries the models from the simplest on, each from the one before; returns the one to use, and what all were worth.
fn choose(
    views: &[&View],
    middle: Middle,
    start: &Parameters,
    options: &IntrinsicsOptions,
) -> Option<(Candidate, Vec<ModelReport>)> {
    let models = options.model.map_or(LensModel::ALL.to_vec(), |m| vec![m]);
    let mut start = start.clone();
    if let Some(stage) = options.stage {
        line_up(&mut start, views, middle, stage.step_mm);
    }
    let mut tried = Vec::new();
    let mut best: Option<Candidate> = None;
    let mut consider = |candidate: Candidate, best: &mut Option<Candidate>| {
        tried.push(ModelReport {
            coefficients: candidate.model.coefficients(),
            bent: candidate.bent,
            held_out_px: candidate.held_out_px,
            bic: candidate.bic,
            chosen: false,
        });
        if best.as_ref().is_none_or(|b| b.is_beaten_by(&candidate)) {
            *best = Some(candidate);
        }
    };
    for model in models {
        let Some(found) = candidate(views, middle, options.stage, model, false, &start) else { continue };
        consider(found, &mut best);
    }
    let flat = best.as_ref()?;
    let (model, from) = (flat.model, flat.fit.parameters.clone());
    if let Some(bent) = candidate(views, middle, options.stage, model, true, &from) {
        consider(bent, &mut best);
    }
    let best = best?;
    for m in &mut tried {
        m.chosen = m.coefficients == best.model.coefficients() && m.bent == best.bent;
    }
    Some((best, tried))
}

/// Lays the stage's line through the poses, which are stretched to its step: as much as the focal length, that of a board
/// that always faced the camera, is stretched.
fn line_up(p: &mut Parameters, views: &[&View], middle: Middle, step_mm: f64) {
    let at: Vec<_> = p.poses.iter().map(|pose| (pose * p.on_board(middle.at, &middle).0).coords).collect();
    let numbers: Vec<f64> = views.iter().map(|v| v.number as f64).collect();
    let n = at.len() as f64;
    let mean = at.iter().sum::<nalgebra::Vector3<f64>>() / n;
    let m = numbers.iter().sum::<f64>() / n;
    let spread: f64 = numbers.iter().map(|i| (i - m).powi(2)).sum();
    let step = numbers.iter().zip(&at).map(|(i, t)| (i - m) * (t - mean)).sum::<nalgebra::Vector3<f64>>() / spread;
    let stretch = step_mm / step.norm();
    if stretch.is_finite() && (0.05..20.0).contains(&stretch) {
        // A board that faces the camera looks the same at k times the depth under k times the focal length.
        p.camera.fx *= stretch;
        p.camera.fy *= stretch;
        for pose in &mut p.poses {
            pose.translation.vector.z *= stretch;
        }
        p.step = step.normalize() * step_mm;
        let mut origin = mean - m * step;
        origin.z *= stretch;
        p.origin = origin;
    }
}

/// Refuses what is not determined, and reports what is.
fn judged(
    data: &bundle::Data<'_>,
    chosen: &Candidate,
    models: Vec<ModelReport>,
    keep_uncertain: bool,
) -> Result<Intrinsics, IntrinsicsError> {
    let mut advice = Vec::new();
    let mut refuse = |e: IntrinsicsError| {
        if keep_uncertain {
            advice.push(e.to_string());
            return Ok(());
        }
        Err(e)
    };
    let fit = &chosen.fit;
    let p = &fit.parameters;
    let camera = p.camera.clone();
    let reports = report::views(data, fit);
    let open = |sigma_px: f64| {
        let tilt = reports.iter().fold(0.0, |a: f64, v| a.max(v.tilt_deg));
        // Far from the truth, angles are as wrong as the focal length is.
        let alike = sigma_px.is_nan() || sigma_px > 0.1 * camera.fx;
        let (reason, remedy) = if tilt < 15.0 || alike {
            let reason = if alike {
                "as boards that face the camera, or are all tilted alike, leave it open".to_owned()
            } else {
                format!("as all boards face the camera within {tilt:.0} degrees")
            };
            (reason, "tilt the board by 20 to 40 degrees, to the left, right, front, and back")
        } else {
            (
                format!("from {} images", reports.len()),
                "add images with the board tilted by 20 to 40 degrees to all four sides, filling the picture",
            )
        };
        let (focal_px, remedy) = (0.5 * (camera.fx + camera.fy), remedy.to_owned());
        IntrinsicsError::FocalLength { focal_px, sigma_px, reason, remedy }
    };
    let Some(covariance) = &fit.covariance else { return Err(open(f64::INFINITY)) };
    let pinhole = report::sigmas(fit, covariance, |s| matches!(s, Shared::Pinhole(_)));
    let focal_sigma = pinhole[0].max(pinhole[1]);
    if focal_sigma.is_nan() || focal_sigma > MAX_FOCAL_SIGMA * camera.fx.min(camera.fy) {
        refuse(open(focal_sigma))?;
    }
    let center_sigma = pinhole[2].max(pinhole[3]);
    if center_sigma.is_nan() || center_sigma > MAX_CENTER_SIGMA * camera.width as f64 {
        let remedy = "add images with the board tilted to all four sides, and turned by 90 degrees".to_owned();
        refuse(IntrinsicsError::PrincipalPoint { sigma_px: center_sigma, remedy })?;
    }
    let (coverage, residual_px) = report::maps(data, fit);
    let (corners, rejected) = reports.iter().fold((0, 0), |a, v| (a.0 + v.corners, a.1 + v.rejected));
    let sum: f64 = reports.iter().map(|v| v.rms_px * v.rms_px * v.corners as f64).sum();
    let sagitta = |k: usize| -p.bend_mm[k] * p.log_scale.exp();
    let scale_sigma = report::sigmas(fit, covariance, |s| s == Shared::LogScale);
    let mut report = IntrinsicsReport {
        coefficients: chosen.model.coefficients(),
        pinhole_px: [camera.fx, camera.fy, camera.cx, camera.cy],
        pinhole_sigma_px: [pinhole[0], pinhole[1], pinhole[2], pinhole[3]],
        distortion: camera.distortion.coeffs().to_vec(),
        distortion_sigma: report::sigmas(fit, covariance, |s| matches!(s, Shared::Coefficient(_))),
        rms_px: (sum / f64::max(corners as f64, 1.0)).sqrt(),
        corner_sigma_px: fit.sigma_px,
        corners,
        rejected,
        views: reports,
        models,
        coverage,
        residual_px,
        sigma_px: report::sigma_map(fit, covariance),
        bend_mm: chosen.bent.then(|| [sagitta(0), sagitta(2)]),
        board_scale: scale_sigma.first().map(|s| [p.log_scale.exp(), p.log_scale.exp() * s]),
        advice,
    };
    let more = report::advice(&report);
    report.advice.extend(more);
    Ok(Intrinsics { camera, report })
}
