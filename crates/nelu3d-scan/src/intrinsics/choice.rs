//! How many coefficients the images support.

use rayon::prelude::*;

use super::bundle::{Data, Fit};
use super::lens::LensModel;
use super::options::StageStep;
use super::parameters::{Middle, Parameters, Shared};
use super::view::View;
use crate::camera::Distortion;
use crate::pose::solve_pnp;

/// A model that was fitted.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub(super) model: LensModel,
    /// Whether the board may be bent.
    pub(super) bent: bool,
    pub(super) fit: Fit,
    /// Root mean square error of corners in images that were left out, px; `None`: too few images to leave any out.
    pub(super) held_out_px: Option<f64>,
    /// Schwarz's information criterion; lower is better.
    pub(super) bic: f64,
    /// Mean squared error of each image's corners while it was left out, px².
    errors: Vec<f64>,
}

/// Parts of the images that are left out in turn.
const FOLDS: usize = 5;
/// Fewest images of which some are left out.
const MIN_VIEWS: usize = 6;

/// The shared parameters of a model.
pub(super) fn free(model: LensModel, bent: bool, stage: bool) -> Vec<Shared> {
    let mut free: Vec<Shared> = (0..4).map(Shared::Pinhole).collect();
    free.extend((0..model.coefficients()).map(Shared::Coefficient));
    if bent {
        free.extend((0..3).map(Shared::Bend));
    }
    if stage {
        free.push(Shared::LogScale);
        free.extend((0..3).map(Shared::Origin));
        free.extend((0..3).map(Shared::Step));
    }
    free
}

/// Fits a model, starting from another fit or from what is known. `None` where nothing is found.
pub(super) fn candidate(
    views: &[&View],
    middle: Middle,
    stage: Option<StageStep>,
    model: LensModel,
    bent: bool,
    start: &Parameters,
) -> Option<Candidate> {
    let free = free(model, bent, stage.is_some());
    let mut start = start.clone();
    let mut k = start.coefficients();
    k[model.coefficients()..].fill(0.0);
    start.camera.distortion = Distortion::new(&k[..model.coefficients()])?;
    let fit = Data { views, middle, stage }.fit(start, &free)?;
    let n = 2.0 * fit.used.iter().flatten().filter(|u| **u).count() as f64;
    let norms = Data { views, middle, stage }.norms(&fit.parameters);
    let used = norms.iter().flatten().zip(fit.used.iter().flatten()).filter(|(_, u)| **u);
    let sum: f64 = used.map(|(r, _)| r * r).sum();
    let bic = n * (sum / n).max(1e-12).ln() + free.len() as f64 * n.ln();
    let errors = held_out(views, middle, &fit);
    let held_out_px = (!errors.is_empty()).then(|| (errors.iter().sum::<f64>() / errors.len() as f64).sqrt());
    Some(Candidate { model, bent, fit, held_out_px, bic, errors })
}

/// Returns the mean squared error (px², two coordinates together) of each image's corners under the camera of the
/// others; poses are fitted, and corners that the whole fit rejected do not count. Empty for few images.
fn held_out(views: &[&View], middle: Middle, fit: &Fit) -> Vec<f64> {
    if views.len() < MIN_VIEWS {
        return Vec::new();
    }
    let fold = |f: usize| -> Option<Vec<(usize, f64)>> {
        let kept: Vec<usize> = (0..views.len()).filter(|i| i % FOLDS != f).collect();
        let some: Vec<&View> = kept.iter().map(|&i| views[i]).collect();
        let poses = kept.iter().map(|&i| fit.parameters.poses[i]).collect();
        let start = Parameters { poses, ..fit.parameters.clone() };
        // A stage's line is of all images: the others keep what it gave.
        let lens: Vec<Shared> = fit
            .free
            .iter()
            .copied()
            .filter(|s| matches!(s, Shared::Pinhole(_) | Shared::Coefficient(_) | Shared::Bend(_)))
            .collect();
        let trained = Data { views: &some, middle, stage: None }.fit(start, &lens)?;
        let mut errors = Vec::new();
        for i in (0..views.len()).filter(|i| i % FOLDS == f) {
            let one = [views[i]];
            let data = Data { views: &one, middle, stage: None };
            let start = Parameters { poses: vec![fit.parameters.poses[i]], ..trained.parameters.clone() };
            let placed = data.fit(start, &[])?;
            let norms = data.norms(&placed.parameters);
            let used: Vec<f64> = norms[0].iter().zip(&fit.used[i]).filter(|(_, u)| **u).map(|(r, _)| r * r).collect();
            if !used.is_empty() {
                errors.push((i, used.iter().sum::<f64>() / used.len() as f64));
            }
        }
        Some(errors)
    };
    let folds: Option<Vec<Vec<(usize, f64)>>> = (0..FOLDS).into_par_iter().map(fold).collect();
    let Some(folds) = folds else { return Vec::new() };
    let mut all = folds.concat();
    all.sort_by_key(|(i, _)| *i);
    all.into_iter().map(|(_, e)| e).collect()
}

impl Candidate {
    /// Returns whether a richer model is worth its parameters: images that were left out are better explained, beyond
    /// one standard error of the difference and by more than one percent; without such images, by Schwarz's criterion.
    pub(super) fn is_beaten_by(&self, richer: &Candidate) -> bool {
        if self.errors.len() != richer.errors.len() || self.errors.is_empty() {
            return richer.bic < self.bic - 10.0;
        }
        // Medians of ratios would do for outliers; robust fits have few.
        let gains: Vec<f64> = self.errors.iter().zip(&richer.errors).map(|(a, b)| a - b).collect();
        let n = gains.len() as f64;
        let mean = gains.iter().sum::<f64>() / n;
        let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let total = self.errors.iter().sum::<f64>() / n;
        mean > (variance / n).sqrt() && mean > 0.01 * total && richer.bic < self.bic
    }
}

/// Returns the start that explains the corners best, after a short fit with two radial coefficients. `None` where no
/// start explains them.
pub(super) fn best_start(views: &[&View], middle: Middle, cameras: Vec<crate::Camera>) -> Option<Parameters> {
    let free: Vec<Shared> = (0..4).map(Shared::Pinhole).chain((0..2).map(Shared::Coefficient)).collect();
    let one = |camera: crate::Camera| -> Option<(f64, Parameters)> {
        let mut poses = Vec::with_capacity(views.len());
        for view in views {
            poses.push(solve_pnp(&view.corners, &camera).ok()?.cam_from_board);
        }
        let mut start = Parameters::new(camera, poses);
        start.camera.distortion = Distortion::new(&[0.0; 4])?;
        let fit = Data { views, middle, stage: None }.fit(start, &free)?;
        let c = &fit.parameters.camera;
        (c.fx > 0.0 && c.fy > 0.0).then_some((fit.sigma_px, fit.parameters))
    };
    let found: Vec<_> = cameras.into_par_iter().filter_map(one).collect();
    found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, p)| p)
}
