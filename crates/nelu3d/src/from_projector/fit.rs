//! Blur and response of a projector from codewords, and the depths of its field.
//!
//! Boards of a sweep are at known points. Scenes are decoded with what is known, compared with the patterns where they
//! were found to come from, and decoded again.

use nelu3d_scan::rig::Capture;
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Image, Projector, Rig};

use super::geometry::{Volume, crossing_depth};
use super::render::render_field;
use super::response::{MIN_CODEWORDS, Residual, Response, exponent_matters, fit_response};
use super::source::Source;
use crate::calibrate::CalibrationError;
use crate::color_field::{ColorField, FieldMetadata, Form};
use crate::progress::Progress;
use crate::reconstruct::{Codeword, decode_codewords};

/// Blur that the estimation begins with, projector px.
const FIRST_BLUR_PX: f32 = 1.5;
/// Exponents that the estimation begins with: projectors are linear in their codes or nearly sRGB.
const FIRST_GAMMAS: [f32; 2] = [1.0, 2.2];
/// Largest number of times that scenes are decoded and the response is fitted, from each start.
const MAX_ROUNDS: usize = 3;
/// Depths that scenes are looked for at, as parts of where the optical axes come closest.
const AROUND_CROSSING: [f64; 2] = [0.6, 1.6];
/// Depths that scenes are looked for at, as parts of where the optical axes come closest, where [`AROUND_CROSSING`]
/// does not explain them: a projector whose lens is shifted throws the middle of its picture elsewhere.
const FAR_AROUND_CROSSING: [f64; 2] = [0.4, 2.5];
/// Median residual that more depths have to leave of scenes, as a part of what fewer leave: where codes repeat, more
/// depths are more to be wrong at.
const BETTER: f64 = 0.8;
/// Times as many pixels of scenes that more depths have to explain as well as fewer do.
const MORE: f64 = 1.08;
/// Depths of a field, as parts of the nearest and the farthest that boards or scenes were found at.
const AROUND: [f64; 2] = [0.8, 1.25];
/// One of so many codewords may lie before, and one behind what is taken for the depths of all.
const FEW: usize = 200;

/// Returns the depths, mm, that codewords lie at, but for the nearest and the farthest few.
fn extent(codewords: &[Codeword]) -> [f64; 2] {
    let mut depths: Vec<f64> = codewords.iter().map(|c| c.point[2]).collect();
    depths.sort_unstable_by(f64::total_cmp);
    let few = depths.len() / FEW;
    [depths[few], depths[depths.len() - 1 - few]]
}

/// The depths of a field, mm, whose boards or scenes were found at depths from `near` to `far`.
fn around([near, far]: [f64; 2]) -> [f64; 2] {
    [AROUND[0] * near, AROUND[1] * far]
}

/// Where the points of codewords come from.
#[derive(Clone, Copy)]
enum Points {
    /// Boards: residuals have all of the noise, and its mean variance.
    Known,
    /// Decoded from the codewords, which takes much of the noise into their depths, most of it where light is dim: the
    /// median variance is what residuals have.
    Decoded,
}

/// Blur and response that were fitted.
pub(super) struct Fitted {
    pub(super) residual: Residual,
    /// Root of the variance that noise gives the codewords' residuals, normalized intensity; see [`Points`].
    pub(super) noise_sigma: f64,
    pub(super) response: Response,
    /// Number of codewords that they were fitted to.
    codewords: usize,
    /// Depths that these lie at, mm.
    depths_mm: [f64; 2],
}

impl Fitted {
    /// Whether this explains the same scenes better than another that was looked for at fewer depths.
    fn is_better_than(&self, other: &Self) -> bool {
        let (more, fewer) = (self.codewords as f64, other.codewords as f64);
        let (own, others) = (self.residual.median, other.residual.median);
        own < BETTER * others && more >= fewer / MORE || own < MORE * others && more > MORE * fewer
    }
}

/// The estimation of blur and response, and all that it compares.
pub(super) struct ResponseFit<'a> {
    pub(super) rig: &'a Rig,
    pub(super) projector: &'a Projector,
    /// Projected images, one plane per channel of the camera; a single row or column where the others are the same.
    pub(super) patterns: Vec<Image>,
    pub(super) metadata: FieldMetadata,
}

impl ResponseFit<'_> {
    /// Fits blur and response to what a field rests on, and returns the depths, mm, that the field is to have, too:
    /// those that are given, or those around the boards or the scenes. `None` if no scene could be decoded.
    pub(super) fn fit(
        &self,
        source: &Source,
        given_mm: Option<[f64; 2]>,
        progress: &Progress,
    ) -> Result<Option<([f64; 2], Fitted)>, CalibrationError> {
        match (source, given_mm) {
            (Source::Boards { codewords, .. }, _) => Ok(Some((
                given_mm.unwrap_or_else(|| around(extent(codewords))),
                self.fit_codewords(codewords, Points::Known),
            ))),
            (Source::Scenes(captures), Some(mm)) => {
                Ok(self.fit_scenes(captures, mm, progress)?.map(|fitted| (mm, fitted)))
            }
            (Source::Scenes(captures), None) => self.find_scenes(captures, progress),
        }
    }

    /// Fits the response to codewords at points.
    fn fit_codewords(&self, codewords: &[Codeword], points: Points) -> Fitted {
        let (response, residual) = fit_response(&self.patterns, self.projector, codewords);
        let mut variances: Vec<f64> = codewords.iter().map(|c| f64::from(c.variance)).collect();
        let variance = match points {
            Points::Known => variances.iter().sum::<f64>() / variances.len().max(1) as f64,
            Points::Decoded => median(&mut variances).unwrap_or(0.0),
        };
        let noise_sigma = variance.sqrt();
        Fitted { residual, noise_sigma, response, codewords: codewords.len(), depths_mm: extent(codewords) }
    }

    /// Looks for scenes around where the optical axes come closest, and fits the response; returns the depths that the
    /// field is to have, mm, too. `None` if no scene could be decoded.
    fn find_scenes(
        &self,
        captures: &[Capture],
        progress: &Progress,
    ) -> Result<Option<([f64; 2], Fitted)>, CalibrationError> {
        let crossing = crossing_depth(&self.rig.camera, self.projector);
        let [near_by, far] = [AROUND_CROSSING, FAR_AROUND_CROSSING].map(|range| range.map(|part| part * crossing));
        let [of_few, of_more] =
            [self.fit_scenes(captures, near_by, progress)?, self.fit_scenes(captures, far, progress)?];
        Ok(match (of_few, of_more) {
            (Some(few), Some(more)) if !more.is_better_than(&few) => Some((near_by, few)),
            (Some(few), None) => Some((near_by, few)),
            (_, more) => more.map(|more| (around(more.depths_mm), more)),
        })
    }

    /// Decodes scenes between two depths, mm, and fits the response by turns, from every start, and returns the fit
    /// with the smallest median residual; `None` if no scene could be decoded.
    fn fit_scenes(
        &self,
        captures: &[Capture],
        depth_mm: [f64; 2],
        progress: &Progress,
    ) -> Result<Option<Fitted>, CalibrationError> {
        let Some(volume) = Volume::new(&self.rig.camera, self.projector, depth_mm) else { return Ok(None) };
        let mut best: Option<Fitted> = None;
        let starts = if exponent_matters(&self.patterns) { &FIRST_GAMMAS[..] } else { &FIRST_GAMMAS[..1] };
        for gamma in starts.iter().copied() {
            let mut response = Response { blur_px: FIRST_BLUR_PX, offset: 0.0, scale: 1.0, gamma };
            for round in 0..MAX_ROUNDS {
                if progress.cancelled() {
                    return Err(CalibrationError::Cancelled);
                }
                let codewords = self.decode(captures, &self.field(response, volume.clone()));
                if codewords.len() < MIN_CODEWORDS {
                    break;
                }
                let fitted = self.fit_codewords(&codewords, Points::Decoded);
                let (of_round, residual) = (fitted.response, fitted.residual.median);
                tracing::debug!(gamma, round, ?of_round, residual, pixels = codewords.len(), "response");
                if best.as_ref().is_some_and(|b| residual >= b.residual.median) {
                    break;
                }
                best = Some(fitted);
                response = of_round;
            }
        }
        Ok(best)
    }

    /// The color field of a response in a volume.
    pub(super) fn field(&self, response: Response, Volume { frame, validity }: Volume) -> ColorField {
        let (grid, cells_per_pixel) = render_field(&self.patterns, self.projector, &frame, response);
        let metadata = FieldMetadata { cells_per_pixel, ..self.metadata.clone() };
        ColorField { frame, form: Form::Grid(grid), validity, metadata }
    }

    /// Decoded points of all captures, and their codewords.
    fn decode(&self, captures: &[Capture], field: &ColorField) -> Vec<Codeword> {
        captures.iter().flat_map(|capture| decode_codewords(capture, &self.rig.camera, field)).collect()
    }
}
