//! Calibrating the projector from the rig's own sweep, when its positions have binary-coded images along x and y.
//!
//! Moreno & Taubin, "Simple, Accurate, and Robust Projector-Camera Calibration" (3DIMPVT 2012): at every corner of the board
//! the decoded pixels around it give a local homography from the camera to the projector, which carries the corner, found to
//! sub-pixel in the white image, to sub-pixel into the projected image. Decoding errors average out, and no pixel of the
//! projector needs to be seen.
//!
//! The rest differs from the paper: there, the projector is calibrated with Zhang's method from views of a plane at several
//! angles, which a board that only slides along a stage does not give. Here the camera is calibrated already, so the corners
//! are known in its frame: a direct linear transform from them to the projected image starts a robust refinement of
//! intrinsics, distortion and pose. It needs several depths, not several angles.

mod corners;
mod fit;
mod response;

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use nelu3d_scan::board::{BoardError, Corner, Detector};
use nelu3d_scan::pose::{PoseError, Trajectory, TrajectoryModel};
use nelu3d_scan::rig::{PatternSet, RIG_FILE, RigError};
use nelu3d_scan::{Projector, Rig};
use serde::{Deserialize, Serialize};

use super::captured::{Captured, Images};
use super::code::{Code, ProjectedLight};
use super::{Error as DecodeError, gray};
use nelu3d::progress::Progress;
use nelu3d::progress::{StageClock, StageTime};
pub use response::Response;

/// Which lens distortion of the projector is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Lens {
    /// None.
    None,
    /// k1, k2.
    Radial,
    /// k1, k2, p1, p2.
    Full,
}

/// Settings of a projector calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Which lens distortion is fitted
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Lens::Full))]
    pub lens: Lens,
    /// Half the side of the square around a corner that its homography is fitted to, camera px (default: a fortieth of the
    /// image's longer side, at least 8)
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX"))]
    pub radius: Option<usize>,
    /// Least white − black of a pixel, as a share of full scale
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.02))]
    pub min_contrast: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { lens: Lens::Full, radius: None, min_contrast: 0.02 }
    }
}

/// Why a projector was not calibrated.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The rig folder or one of its images.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The code.
    #[error(transparent)]
    Code(#[from] DecodeError),
    /// The board in rig.toml.
    #[error("{}: {source}", path.display())]
    Board {
        /// rig.toml.
        path: PathBuf,
        /// What is wrong with it.
        source: BoardError,
    },
    /// The poses of the sweep.
    #[error("{}: {source}", path.display())]
    Pose {
        /// The calibration folder.
        path: PathBuf,
        /// What is wrong.
        source: PoseError,
    },
    /// Something that the calibration needs is missing, or there is too little of it.
    #[error("{}: {problem}; {remedy}", path.display())]
    Needs {
        /// The file or folder.
        path: PathBuf,
        /// What is missing.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// The user stopped it.
    #[error("stopped before the projector was calibrated; nothing was written")]
    Cancelled,
}

impl Error {
    fn needs(path: impl Into<PathBuf>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Needs { path: path.into(), problem: problem.into(), remedy: remedy.into() }
    }
}

/// How well a projector was calibrated.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The pattern set that was decoded.
    pub set: String,
    /// Board positions with corners that were used.
    pub positions: usize,
    /// Corners used.
    pub corners: usize,
    /// Corners left out: too little was decoded around them, or they contradict the others.
    pub rejected: usize,
    /// Root mean square distance between a corner's decoded and computed projector pixel, px.
    pub rms_px: f64,
    /// Range of the corners' depths, mm: outside of it the calibration extrapolates.
    pub depth_mm: [f64; 2],
    /// The projector's center in the camera's frame, mm.
    pub center_mm: [f64; 3],
    /// Its standard deviation, from the residuals alone, mm.
    pub center_sigma_mm: [f64; 3],
    /// ProjectedLight per projected value, where the sweep has images with values between black and white.
    pub response: Option<Response>,
    /// What took how long.
    pub stages: Vec<StageTime>,
}

/// A corner of a board in the camera's frame and in the projected image.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Camera frame, mm.
    point: Point3<f64>,
    /// Projector px.
    px: [f64; 2],
}

/// Fewest corners that determine a projector with some certainty.
const FEWEST_CORNERS: usize = 24;

/// Calibrates the projector of a rig. `set` is a binary code along x and y; without one, the first that is.
///
/// # Errors
///
/// The rig has no board, no sweep, no set with a binary code along both axes, or too few positions or corners; or the
/// corners do not determine a projector.
pub fn calibrate(
    rig: &Rig,
    set: Option<&str>,
    opts: &Options,
    progress: &Progress,
) -> Result<(Projector, Report), Error> {
    let mut clock = StageClock::new(progress);
    clock.begin("read the projected patterns");
    let rig_file = rig.root.join(RIG_FILE);
    let board = rig.board.as_ref().ok_or_else(|| {
        Error::needs(
            &rig_file,
            "[board] is missing",
            "describe the target of the sweep, or calibrate the projector elsewhere",
        )
    })?;
    let (set, code, size) = coded_set(rig, set)?;
    let shots = rig.positions()?;
    let folder = rig.root.join("calibration");

    clock.begin("find the boards");
    let detector =
        Detector::new(board).map_err(|source| Error::Board { path: rig_file, source })?.with_camera(&rig.camera);
    let mut found = Vec::new();
    let mut decoded = Vec::new();
    for (i, shot) in shots.iter().enumerate() {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        progress.tick(i, shots.len());
        let white = rig.reader(shot).read(&rig.white)?;
        let corners = detector.detect(&white.to_gray(), white.width, white.height);
        let corners: Result<Vec<Corner>, String> = corners.map_err(|e| e.to_string());
        let seen = match &corners {
            Ok(corners) => {
                // A sweep rarely has inverses; use them if this position does.
                let mut here = set.clone();
                if !here.inverse.iter().all(|name| shot.dir.join(name).exists()) {
                    here.inverse.clear();
                }
                let images = Images::read_position(rig, shot, &here)?;
                let captured = Captured::new(&images, rig, opts.min_contrast);
                let radius = opts.radius.unwrap_or((rig.camera.width.max(rig.camera.height) / 40).max(8));
                corners::decode(&captured, &code, &here, corners, radius)?
            }
            Err(_) => Vec::new(),
        };
        decoded.push(seen);
        found.push((shot.name.clone(), corners));
    }

    clock.begin("solve the board poses");
    let trajectory = if rig.poses.is_empty() {
        Trajectory::fit(&found, &rig.camera, TrajectoryModel::Auto)
    } else {
        Trajectory::from_known(&rig.poses)
    };
    let trajectory = trajectory.map_err(|source| Error::Pose { path: folder.clone(), source })?;
    for r in &trajectory.rejected {
        progress.warn(format!("board position {} is not used: {}", r.position, r.reason));
    }

    clock.begin("fit the projector");
    let (mut samples, mut positions, mut lost) = (Vec::new(), Vec::new(), 0);
    for p in &trajectory.positions {
        let Some(at) = found.iter().position(|(name, _)| *name == p.position) else { continue };
        let Ok(corners) = &found[at].1 else { continue };
        let before = samples.len();
        for (corner, px) in corners.iter().zip(&decoded[at]) {
            let point = p.cam_from_board * Point3::new(corner.board_mm[0], corner.board_mm[1], 0.0);
            match px {
                Some(px) => samples.push(Sample { point, px: *px }),
                None => lost += 1,
            }
        }
        if samples.len() > before {
            positions.push((at, p.cam_from_board));
        }
    }
    if positions.len() < 3 || samples.len() < FEWEST_CORNERS {
        return Err(Error::needs(
            folder,
            format!(
                "{} corners at {} positions could be decoded, and {FEWEST_CORNERS} at 3 are needed",
                samples.len(),
                positions.len()
            ),
            "capture the board, lit by the whole code, at more positions",
        ));
    }
    let fitted = fit::fit(&samples, size, opts.lens).ok_or_else(|| {
        Error::needs(
            folder.clone(),
            "the corners do not determine a projector",
            "move the board through more depths, and check that patterns/ holds what was projected",
        )
    })?;
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }

    clock.begin("measure the response");
    let response = response::measure(rig, &fitted.projector, board.extent_mm, &positions, &shots)?;
    let depths = samples.iter().map(|s| s.point.z);
    let center = fitted.projector.center();
    let report = Report {
        set: set.name.clone(),
        positions: positions.len(),
        corners: samples.len() - fitted.rejected,
        rejected: fitted.rejected + lost,
        rms_px: fitted.rms_px,
        depth_mm: [depths.clone().fold(f64::INFINITY, f64::min), depths.fold(0.0, f64::max)],
        center_mm: center.coords.into(),
        center_sigma_mm: fitted.center_sigma_mm,
        response,
        stages: clock.finish(),
    };
    Ok((fitted.projector, report))
}

/// The set to decode, its code, and the size of the projected image.
fn coded_set<'a>(rig: &'a Rig, name: Option<&str>) -> Result<(&'a PatternSet, Code, [usize; 2]), Error> {
    let both = |set: &'a PatternSet| -> Result<(&'a PatternSet, Code, [usize; 2]), Error> {
        let code = Code::read_sized(rig, set, None, &ProjectedLight::Power(1.0))?;
        let [x, y] = &code.axes[..] else {
            return Err(Error::needs(
                rig.root.join(RIG_FILE),
                format!("set `{}` has a code along one axis only", set.name),
                "give a set with a binary code along x and one along y",
            ));
        };
        gray::Table::new(x, set)?;
        gray::Table::new(y, set)?;
        let size = [x.len(), y.len()];
        Ok((set, code, size))
    };
    if let Some(name) = name {
        return both(rig.pattern_set(Some(name))?);
    }
    rig.pattern_sets.iter().find_map(|set| both(set).ok()).ok_or_else(|| {
        Error::needs(
            rig.root.join(RIG_FILE),
            "no pattern set has binary codes along x and along y, with its projected images in patterns/",
            "capture the sweep with Gray code along both axes (sets of one axis alone can be joined to one set)",
        )
    })
}

/// Writes a projector file: `projector.json` in the LookUp3D tools' form, with two keys that other readers ignore:
/// `calibration` (what [`Report`] says of its quality) and `response` (see [`Response`]).
///
/// # Errors
///
/// The file cannot be written.
pub fn write(path: &Path, projector: &Projector, report: &Report) -> std::io::Result<()> {
    let dir = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let scratch = tempfile::tempdir_in(dir)?;
    let plain = scratch.path().join("projector.json");
    nelu3d_scan::camera::write_projector(&plain, projector)?;
    let mut json: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(&std::fs::read(&plain)?)?;
    let calibration = serde_json::json!({
        "set": report.set,
        "positions": report.positions,
        "corners": report.corners,
        "rms_px": report.rms_px,
        "depth_mm": report.depth_mm,
        "version": env!("CARGO_PKG_VERSION"),
    });
    json.insert("calibration".into(), calibration);
    if let Some(response) = &report.response {
        json.insert("response".into(), serde_json::to_value(response)?);
    }
    nelu3d_scan::output::write_atomic(path, |w| {
        serde_json::to_writer_pretty(&mut *w, &json)?;
        w.write_all(b"\n")
    })
}

/// The response of a projector file that [`write`] wrote; `None` if it has none.
pub(crate) fn read_response(path: &Path) -> Result<Option<Response>, DecodeError> {
    // Other formats than ours have no response.
    let Some(json) = std::fs::read(path).ok().and_then(|b| serde_json::from_slice::<serde_json::Value>(&b).ok()) else {
        return Ok(None);
    };
    let Some(value) = json.get("response") else { return Ok(None) };
    let broken = |problem: String| {
        DecodeError::file(
            path,
            format!("`response` {problem}"),
            "write it again with `nelu3d projector`, or give --gamma",
        )
    };
    let response: Response =
        serde_json::from_value(value.clone()).map_err(|e| broken(format!("is no response: {e}")))?;
    response.check().map_err(|problem| broken(problem.into()))?;
    Ok(Some(response))
}
