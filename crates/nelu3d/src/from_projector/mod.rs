//! A color field without a sweep, from a calibrated projector and the images that it projected.
//!
//! c(x) is then the pattern at the projector pixel that lights x, through the projector's optics (a blur) and its
//! response (a curve). Neither is in any calibration file, so both are estimated: from the boards of a sweep, where
//! there is one, whose points are known; else from scenes: decode with what is known, compare the captures with the
//! patterns where they were found to come from, and repeat. What few patterns say of a scene can be explained by a
//! wrong response and wrong depths together.

mod geometry;
#[doc(hidden)]
pub mod inputs;
mod options;
mod render;
#[doc(hidden)]
pub mod response;

use nelu3d_scan::rig::{Capture, PatternSet};
use nelu3d_scan::{Image, Projector, Rig};

use crate::calibrate::{BoardSample, BoardSamples, CalibrationError, CalibrationReport, board_samples};
use crate::color_field::frame::{Center, FieldFrame};
use crate::color_field::validity::Validity;
use crate::color_field::{ColorField, FieldMetadata, Form, ProjectorResidual, camera_key};
use crate::progress::{Progress, StageClock};
use crate::reconstruct::{Codeword, decode_codewords};
use crate::sensor::{DarkLevel, NoiseModel};
use crate::verdict::{Code, Finding, Judgment, Verdict};
pub use geometry::crossing_depth;
use geometry::{lit_volume, overlap_frame};
use inputs::{calibrated_projector, find_scenes, given_depth, projector_error, read_captures, read_patterns};
pub use options::FromProjectorOptions;
use render::render_field;
use response::{Residual, Response, exponent_matters, fit_response};

/// Blur that the estimation begins with, projector px.
const FIRST_BLUR_PX: f32 = 1.5;
/// Exponents that the estimation begins with: projectors are linear in their codes or nearly sRGB.
const FIRST_GAMMAS: [f32; 2] = [1.0, 2.2];
/// Largest number of times that scenes are decoded and the response is fitted, from each start.
const MAX_ROUNDS: usize = 3;
/// Depths that scenes are looked for at, as parts of where the optical axes come closest.
const AROUND_CROSSING: [f64; 2] = [0.6, 1.6];
/// The same where these do not explain the scenes: a projector whose lens is shifted throws the middle of its picture
/// elsewhere.
const FAR_AROUND_CROSSING: [f64; 2] = [0.4, 2.5];
/// How much better more depths have to explain scenes (median residual), or how many more of their pixels as well:
/// where codes repeat, more depths are more to be wrong at.
const BETTER: f64 = 0.8;
const MORE: f64 = 1.08;
/// Depths of a field, as parts of the nearest and the farthest that boards or scenes were found at.
const AROUND: [f64; 2] = [0.8, 1.25];
/// One of so many codewords may lie before, and one behind what is taken for the depths of all.
const FEW: usize = 200;
/// Fewest decoded pixels that a response is fitted to.
const MIN_CODEWORDS: usize = 500;

/// Computes a color field from the calibrated projector, its projected images, and the boards of a sweep or, where
/// there is none that can be used, the captures of up to four scenes, which tell its blur and response.
///
/// # Errors
///
/// The projector or a projected image is missing or does not fit, an image cannot be read, there is neither a sweep nor
/// a scene that could be decoded, or the caller stopped the work.
pub fn calibrate_from_projector(
    rig: &Rig,
    set: &PatternSet,
    opts: &FromProjectorOptions,
    progress: &Progress,
) -> Result<(ColorField, CalibrationReport), CalibrationError> {
    let mut clock = StageClock::new(progress);
    clock.begin("read the patterns");
    let projector = calibrated_projector(rig)?;
    let patterns = read_patterns(rig, set, projector)?;
    let given_mm = given_depth(rig, opts)?;
    let no_scene = || {
        let reason = "no scene could be decoded, so blur and response stay unknown; check the projector's calibration, \
                      or give a depth range";
        projector_error(rig.root.join("scenes"), reason)
    };

    let known = known_codewords(rig, set, progress, &mut clock)?;
    let (source, noise, dark) = match known {
        Some(known) => known,
        None => {
            let scenes = find_scenes(rig, set)?;
            clock.begin("read the scenes");
            let (captures, noise) = read_captures(rig, set, &scenes)?;
            (Source::Scenes(captures), noise, Vec::new())
        }
    };

    clock.begin("estimate blur and response");
    let fit = ResponseFit { rig, projector, patterns, metadata: FieldMetadata { dark, ..metadata(rig, set, noise) } };
    let (depth_mm, fitted) = match (&source, given_mm) {
        (Source::Boards { codewords, .. }, _) => {
            (given_mm.unwrap_or_else(|| around(extent(codewords))), fit.fit_codewords(codewords))
        }
        (Source::Scenes(captures), Some(mm)) => (mm, fit.fit_scenes(captures, mm, progress)?.ok_or_else(no_scene)?),
        (Source::Scenes(captures), None) => fit.find_scenes(captures, progress)?.ok_or_else(no_scene)?,
    };
    let Fitted { residual: Residual { median: residual, rms }, noise_sigma, response, .. } = fitted;
    let mut field =
        fit.field(response, Volume::new(rig, projector, depth_mm).ok_or_else(|| no_overlap(rig, depth_mm))?);
    field.metadata.settings = serde_json::json!({
        "options": opts, "response": response, "residual": residual, "depth_mm": depth_mm,
    });
    field.metadata.residual = Some(ProjectorResidual { sigma: rms, noise_sigma });
    let center = projector.center();
    let mut judgment = Judgment::default();
    judgment.extend(source.unsure(&fit.patterns, response));
    let report = CalibrationReport {
        judgment,
        boards_mm: None,
        corner_rms_px: None,
        trajectory: None,
        light_mm: Some([center.x, center.y, center.z]),
        quality: None,
        frame: format!(
            "light: the calibrated projector, blur {:.2} px, response {:.3} + {:.3} v^{:.2} from {source}, \
             median residual {residual:.3}",
            response.blur_px, response.offset, response.scale, response.gamma
        ),
        shortfall: None,
        excluded: Vec::new(),
        refined_poses: None,
        carried: None,
        cells: field.to_grid().cells,
        stages: clock.finish(),
    };
    Ok((field, report))
}

/// What blur and response are estimated from.
enum Source {
    /// Boards of a sweep: codewords at points that are known.
    Boards {
        /// What they show.
        codewords: Vec<Codeword>,
        /// Number of board positions.
        positions: usize,
    },
    /// Scenes, whose points are found by decoding.
    Scenes(Vec<Capture>),
}

impl Source {
    /// Returns the note that the response rests on scenes, where it matters.
    fn unsure(&self, patterns: &[Image], response: Response) -> Option<Finding> {
        let Source::Scenes(_) = self else { return None };
        exponent_matters(patterns).then(|| {
            let sentence = format!(
                "the projector's response v^{:.2} was found from scenes alone: of few patterns, another response with \
                 other depths may explain the same images",
                response.gamma
            );
            let remedy = "add a board sweep, three positions or more, on which points are known";
            Finding::new(Code::ResponseFromScenes, Verdict::Good, sentence, remedy)
                .with("exponent", f64::from((100.0 * response.gamma).round()) / 100.0)
                .with("channels", patterns.len())
        })
    }
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Source::Boards { positions, .. } => write!(f, "{positions} boards"),
            Source::Scenes(captures) if captures.len() == 1 => write!(f, "a scene"),
            Source::Scenes(captures) => write!(f, "{} scenes", captures.len()),
        }
    }
}

/// Returns what the boards of the rig's sweep show, the sensor's noise, and the light that is there without the projector;
/// `None` without a sweep, or with a warning where it cannot be used.
fn known_codewords(
    rig: &Rig,
    set: &PatternSet,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<Option<(Source, NoiseModel, Vec<DarkLevel>)>, CalibrationError> {
    if rig.board.is_none() || rig.positions().is_err() {
        return Ok(None);
    }
    let unusable = match board_samples(rig, set, progress, clock) {
        Ok(BoardSamples { samples, positions, noise, dark }) if samples.len() >= MIN_CODEWORDS => {
            let codeword = |s: BoardSample| Codeword { point: s.point, intensities: s.values, variance: s.variance };
            let codewords = samples.into_iter().map(codeword).collect();
            return Ok(Some((Source::Boards { codewords, positions }, noise, dark)));
        }
        Ok(BoardSamples { samples, .. }) => format!("only {} pixels of its boards are well lit", samples.len()),
        Err(CalibrationError::Cancelled) => return Err(CalibrationError::Cancelled),
        Err(error) => error.to_string(),
    };
    progress.warn(format!(
        "blur and response of the projector are estimated from scenes, not on the sweep's boards: {unusable}"
    ));
    Ok(None)
}

/// The error of light and view that do not overlap.
fn no_overlap(rig: &Rig, [near, far]: [f64; 2]) -> CalibrationError {
    let reason = format!(
        "its light and the camera's view do not overlap between {near:.0} and {far:.0} mm; check R and T, or give a \
         depth range"
    );
    projector_error(rig.root.join("projector.json"), reason)
}

/// Returns the metadata of the field, as far as they are known before blur and response.
fn metadata(rig: &Rig, set: &PatternSet, noise: NoiseModel) -> FieldMetadata {
    FieldMetadata {
        version: env!("CARGO_PKG_VERSION").into(),
        rig: rig.name.clone(),
        set: set.name.clone(),
        images: set.images.clone(),
        mono: Vec::new(),
        channels: rig.channels.count(),
        center: Center::Light,
        source: "projector".into(),
        camera: camera_key(&rig.camera),
        noise,
        blur: None,
        dark: Vec::new(),
        crosstalk: None,
        cells_per_pixel: 1,
        step_mm: 0.0,
        quality: None,
        residual: None,
        warnings: Vec::new(),
        boards: Vec::new(),
        board_bend: None,
        corrected: Vec::new(),
        settings: serde_json::Value::Null,
    }
}

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

/// Where light and view overlap between two depths.
#[derive(Clone)]
struct Volume {
    frame: FieldFrame,
    validity: Validity,
}

impl Volume {
    /// Finds it between two depths, mm, if there is any.
    fn new(rig: &Rig, projector: &Projector, depth_mm: [f64; 2]) -> Option<Self> {
        let frame = overlap_frame(&rig.camera, projector, depth_mm)?;
        let validity = lit_volume(&rig.camera, projector, &frame, depth_mm);
        Some(Self { frame, validity })
    }
}

/// Blur and response that were fitted.
struct Fitted {
    residual: Residual,
    /// Root of the mean variance that noise gives the codewords, normalized intensity.
    noise_sigma: f64,
    response: Response,
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
struct ResponseFit<'a> {
    rig: &'a Rig,
    projector: &'a Projector,
    /// Projected images, one plane per channel of the camera; a single row or column where the others are the same.
    patterns: Vec<Image>,
    metadata: FieldMetadata,
}

impl ResponseFit<'_> {
    /// Fits the response to codewords at known points.
    fn fit_codewords(&self, codewords: &[Codeword]) -> Fitted {
        let (response, residual) = fit_response(&self.patterns, self.projector, codewords);
        let variance = codewords.iter().map(|c| f64::from(c.variance)).sum::<f64>() / codewords.len().max(1) as f64;
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

    /// Decodes scenes between two depths, mm, and fits the response by turns, from every start, and returns the fit with
    /// the smallest median residual; `None` if no scene could be decoded.
    fn fit_scenes(
        &self,
        captures: &[Capture],
        depth_mm: [f64; 2],
        progress: &Progress,
    ) -> Result<Option<Fitted>, CalibrationError> {
        let Some(volume) = Volume::new(self.rig, self.projector, depth_mm) else { return Ok(None) };
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
                let fitted = self.fit_codewords(&codewords);
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
    fn field(&self, response: Response, Volume { frame, validity }: Volume) -> ColorField {
        let form = Form::Grid(render_field(&self.patterns, self.projector, &frame, response));
        ColorField { frame, form, validity, metadata: self.metadata.clone() }
    }

    /// Decoded points of all captures, and their codewords.
    fn decode(&self, captures: &[Capture], field: &ColorField) -> Vec<Codeword> {
        captures.iter().flat_map(|capture| decode_codewords(capture, &self.rig.camera, field)).collect()
    }
}
