//! From a board sweep to a color field (method.md §1): read and normalize, find the boards, find where the light comes
//! from, fit c, and measure it at positions that it has not seen.

mod candidate;
pub mod dark;
pub mod light;
pub mod noise;
pub mod placed;
pub mod projector;
pub mod sweep;

use std::path::PathBuf;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_field::device::{Choice, Device, DeviceError};
use nelu3d_scan::board::{BoardError, Detector};
use nelu3d_scan::pose::{PoseError, Trajectory, TrajectoryModel};
use nelu3d_scan::rig::{PatternSet, RigError};
use nelu3d_scan::{Camera, Rig};
use serde::{Deserialize, Serialize};

use crate::color_field::frame::{Center, Frame};
use crate::color_field::frequency::Octaves;
use crate::color_field::{About, ColorField, Quality};
use crate::progress::Progress;
use crate::result::{StageClock, StageTime};
use candidate::Candidate;
use dark::{DarkEstimator, DarkLevel};
use light::Views;
use noise::NoiseEstimator;
use placed::Placed;
use sweep::{Position, Sweep};

/// How c is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FormKind {
    /// Cubic B-spline over the frame, fitted by least squares.
    Grid,
    /// Multiresolution hash encoding and a small network.
    Hash,
    /// Sines and cosines in octaves and a network.
    Frequency,
}

/// Where the frame of the field is centered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FrameKind {
    /// In the light if the sweep bears it out, else in the camera.
    Auto,
    /// In the light source.
    Light,
    /// In the camera.
    Camera,
}

/// How the board moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum TrajectoryKind {
    /// On a stage if that explains the corners, else freely.
    Auto,
    /// Every pose on its own.
    Free,
    /// One rotation, positions on one line.
    Stage,
}

/// Settings of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// How the color field is stored
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = FormKind::Grid))]
    pub form: FormKind,
    /// Octaves of the frequency form
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Octaves::Supervised))]
    pub octaves: Octaves,
    /// Where the field's coordinates are centered
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = FrameKind::Auto))]
    pub frame: FrameKind,
    /// How the board moved
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = TrajectoryKind::Auto))]
    pub trajectory: TrajectoryKind,
    /// Hold out every Nth board position to measure the field (the stored field is then fitted to all)
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 8))]
    pub hold_out: usize,
    /// Least white − black of a sample, as a share of full scale
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.02))]
    pub min_contrast: f32,
    /// Seed of everything random
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0))]
    pub seed: u64,
    /// Where form hash is trained: auto (a GPU, if there is one), cpu, gpu, or gpu:N as in `nelu3d devices`
    #[serde(skip)]
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Choice::Auto))]
    pub device: Choice,
    /// Compute the field from the calibrated projector and the projected images instead of a sweep
    #[cfg_attr(feature = "clap", arg(long))]
    pub from_projector: bool,
    /// Depth range of the field in mm, for --from-projector (default: where the light and the view overlap)
    #[cfg_attr(feature = "clap", arg(long, num_args = 2, value_names = ["NEAR", "FAR"]))]
    pub depth: Option<Vec<f64>>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            form: FormKind::Grid,
            octaves: Octaves::Supervised,
            frame: FrameKind::Auto,
            trajectory: TrajectoryKind::Auto,
            hold_out: 8,
            min_contrast: 0.02,
            seed: 0,
            device: Choice::Cpu,
            from_projector: false,
            depth: None,
        }
    }
}

/// Why a calibration failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The rig folder or one of its images.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The board's description.
    #[error("{path}: {source}")]
    Board {
        /// The rig.toml.
        path: PathBuf,
        /// What is wrong.
        source: BoardError,
    },
    /// The poses.
    #[error("{path}: {source}")]
    Pose {
        /// The calibration folder.
        path: PathBuf,
        /// What is wrong.
        source: PoseError,
    },
    /// There is no board.
    #[error(
        "{0}: [board] is missing; describe the target of the sweep, or use --from-projector with a calibrated projector"
    )]
    NoBoard(PathBuf),
    /// There are too few positions.
    #[error("{path}: {found} usable board positions, and at least 3 are needed; capture more{reasons}")]
    TooFew {
        /// The calibration folder.
        path: PathBuf,
        /// How many there are.
        found: usize,
        /// Why others were not usable.
        reasons: String,
    },
    /// No sample is usable.
    #[error("{path}: {reason}")]
    NoSamples {
        /// The calibration folder.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The projector's data are missing or do not fit.
    #[error("{path}: {reason}")]
    Projector {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The device that was asked for is not there.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The user stopped it.
    #[error("stopped before the color field was finished; nothing was written")]
    Cancelled,
}

/// What a calibration found.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The poses, position by position; none for a field from the projector.
    pub trajectory: Option<Trajectory>,
    /// Where the light is, camera frame, mm; none for parallel light.
    pub light_mm: Option<[f64; 3]>,
    /// How well the field predicts what it has not seen.
    pub quality: Option<Quality>,
    /// Where the frame is centered, and why.
    pub frame: String,
    /// Cells of the field along a, b and w.
    pub cells: [usize; 3],
    /// What took how long.
    pub stages: Vec<StageTime>,
}

/// Calibrates a rig for one pattern set.
pub fn run(rig: &Rig, set: &PatternSet, opts: &Options, progress: &Progress) -> Result<(ColorField, Report), Error> {
    Device::open(opts.device)?;
    if opts.from_projector {
        return projector::run(rig, set, opts, progress);
    }
    let mut clock = StageClock::new(progress);
    let (mut placed, trajectory, dark) = place(rig, set, opts, progress, &mut clock)?;
    let (mut field, mut report) = from_sweep(&mut placed, rig, opts, progress, &mut clock)?;
    field.about.dark = dark;
    field.about.rig = rig.name.clone();
    field.about.set = set.name.clone();
    field.about.images = set.images.clone();
    field.about.mono = placed.sweep.mono();
    report.trajectory = Some(trajectory);
    report.stages = clock.finish();
    Ok((field, report))
}

/// Cells per pixel across where one is not enough.
const FINE: usize = 2;

/// Finds the boards of a sweep and where they were; and on the way what is seen without the light.
pub(crate) fn place<'a>(
    rig: &'a Rig,
    set: &'a PatternSet,
    opts: &Options,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<(Placed<'a>, Trajectory, Vec<DarkLevel>), Error> {
    let board = rig.board.as_ref().ok_or_else(|| Error::NoBoard(rig.root.join("rig.toml")))?;
    let detector = Detector::new(board)
        .map_err(|source| Error::Board { path: rig.root.join("rig.toml"), source })?
        .with_camera(&rig.camera);
    let shots = rig.positions()?;
    let folder = rig.root.join("calibration");
    if shots.len() < 3 {
        return Err(Error::TooFew { path: folder, found: shots.len(), reasons: String::new() });
    }

    clock.begin("find the boards");
    let mut sweep = Sweep::new(rig, set, shots, opts.min_contrast);
    let (found, dark) = find_boards(&sweep, &detector, opts, progress)?;

    clock.begin("solve the board poses");
    let trajectory = if rig.poses.is_empty() {
        let model = match opts.trajectory {
            TrajectoryKind::Auto => TrajectoryModel::Auto,
            TrajectoryKind::Free => TrajectoryModel::Free,
            TrajectoryKind::Stage => TrajectoryModel::Stage,
        };
        Trajectory::fit(&found, &rig.camera, model)
    } else {
        Trajectory::from_known(&rig.poses)
    };
    let trajectory = trajectory.map_err(|source| Error::Pose { path: folder.clone(), source })?;
    for r in &trajectory.rejected {
        progress.warn(format!("board position {} is not used: {}", r.position, r.reason));
    }
    let poses = join(&mut sweep, &trajectory);
    if poses.len() < 3 {
        let reasons = trajectory.rejected.iter().map(|r| format!("; {}: {}", r.position, r.reason)).collect();
        return Err(Error::TooFew { path: folder, found: poses.len(), reasons });
    }
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    Ok((Placed::new(sweep, &poses, rig.camera.clone(), board.extent_mm), trajectory, dark))
}

/// What detection said of each position.
type Found = Vec<(String, Result<Vec<nelu3d_scan::board::Corner>, String>)>;

/// Looks for the board in every white image, and at what is left without the light.
fn find_boards(
    sweep: &Sweep<'_>,
    detector: &Detector,
    opts: &Options,
    progress: &Progress,
) -> Result<(Found, Vec<DarkLevel>), Error> {
    let parts = sweep.flashes(progress, |shot, white, black| {
        let corners = detector.detect(&white.to_gray(), white.width, white.height).map_err(|e| e.to_string());
        let mut dark = DarkEstimator::default();
        dark.add(white, black, opts.min_contrast);
        ((shot.name.clone(), corners), dark)
    })?;
    let mut all = DarkEstimator::default();
    let mut found = Found::with_capacity(parts.len());
    for (corners, dark) in parts {
        all.merge(&dark);
        found.push(corners);
    }
    Ok((found, all.finish()))
}

/// Keeps the positions that have a pose, in order.
fn join(sweep: &mut Sweep<'_>, trajectory: &Trajectory) -> Vec<Isometry3<f64>> {
    let pose_of = |name: &str| trajectory.positions.iter().find(|p| p.position == name).map(|p| p.cam_from_board);
    sweep.retain(|name| pose_of(name).is_some());
    sweep.shots.iter().filter_map(|s| pose_of(&s.name)).collect()
}

/// Fits a color field to a placed sweep and measures it at held-out positions.
fn from_sweep(
    placed: &mut Placed<'_>,
    rig: &Rig,
    opts: &Options,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<(ColorField, Report), Error> {
    clock.begin("find the light");
    let n_positions = placed.n_positions();
    let views = look(placed, rig, opts.frame != FrameKind::Camera, progress)?;
    let center = views.and_then(|views| light::find_center(views, &placed.camera, Vector3::x(), progress));
    let stride = opts.hold_out.max(2);
    // From the middle of the first stride on, so that held-out positions lie between others.
    let mut held: Vec<usize> = (0..n_positions).filter(|p| p % stride == stride / 2).collect();
    held.retain(|p| *p > 0 && p + 1 < n_positions);
    if held.is_empty() {
        held.push(n_positions / 2);
    }

    clock.begin("fit the field without the held-out positions");
    let mut tries = Vec::new();
    if let Some(c) = &center {
        let frame = Frame::new(c.origin, c.along, c.kappa, Vector3::x());
        tries.push(Candidate::new(placed, frame, Center::Light, 1, &held, opts, progress)?);
        let q = &tries[0].quality;
        tracing::debug!(psnr = q.psnr_db, ceiling = q.ceiling_db, "field in the light's frame");
    }
    let is_good = |tries: &[Candidate]| tries.iter().any(|t| t.quality.psnr_db > t.quality.ceiling_db - 3.0);
    if let Some(c) = &center
        && !is_good(&tries)
    {
        // Codes with edges are finer than pixels, and the positions see them between the pixels of each other.
        tries.iter_mut().for_each(Candidate::forget_bins);
        let frame = Frame::new(c.origin, c.along, c.kappa, Vector3::x());
        tries.push(Candidate::new(placed, frame, Center::Light, FINE, &held, opts, progress)?);
    }
    let finer_is_better = tries.len() == 2 && tries[1].quality.psnr_db > tries[0].quality.psnr_db + 3.0;
    let light_is_good = is_good(&tries) || finer_is_better;
    if tries.is_empty() || (opts.frame == FrameKind::Auto && !light_is_good) {
        tries.iter_mut().for_each(Candidate::forget_bins);
        let middle = Point3::from(placed.mean_point());
        let frame = Frame::around(Point3::origin(), middle, Vector3::x());
        tries.push(Candidate::new(placed, frame, Center::Camera, 1, &held, opts, progress)?);
    }
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    let mut best = tries
        .into_iter()
        .max_by(|a, b| a.quality.psnr_db.total_cmp(&b.quality.psnr_db))
        .expect("at least one frame was tried");

    clock.begin("fit the field to all positions");
    let form = best.finish(placed, opts, progress)?;
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    let Candidate { frame, center: kind, cells, fineness, validity, quality, .. } = best;
    let about = About {
        version: env!("CARGO_PKG_VERSION").into(),
        rig: String::new(),
        set: String::new(),
        images: Vec::new(),
        mono: Vec::new(),
        channels: placed.sweep.channels,
        center: kind,
        source: "sweep".into(),
        camera: camera_key(&placed.camera),
        noise: placed.noise,
        dark: Vec::new(),
        mixing: None,
        fineness,
        step_mm: placed.typical_step_mm(),
        quality: Some(quality.clone()),
        settings: serde_json::to_value(opts).expect("plain data serializes"),
    };
    let report = Report {
        trajectory: None,
        light_mm: (kind == Center::Light).then(|| frame.center()).flatten().map(|c| [c.x, c.y, c.z]),
        quality: Some(quality),
        frame: match (kind, center.is_some(), opts.frame) {
            (Center::Light, ..) => "light: codewords are constant along its rays".into(),
            (Center::Camera, _, FrameKind::Camera) => "camera: as asked".into(),
            (Center::Camera, true, _) => "camera: it predicts held-out positions better than the light's frame".into(),
            (Center::Camera, false, _) => "camera: no center of the light explains the sweep".into(),
        },
        cells,
        stages: Vec::new(),
    };
    Ok((ColorField { frame, form, validity, about }, report))
}

/// Looks at a selection of positions, of bounded number and evenly spread over the sweep: the sensor's noise goes to
/// `placed`, and with `keep` the views that the light's center is found from are returned.
fn look<'a>(placed: &mut Placed<'a>, rig: &Rig, keep: bool, progress: &Progress) -> Result<Option<Views>, Error> {
    let which = light::selection(placed.n_positions());
    let (k, channels) = (placed.sweep.k, placed.sweep.channels);
    let mut views = keep.then(|| Views::new(&placed.camera, k, which.len()));
    let block = views.as_ref().map(|v| v.block);
    let boards = &placed.boards;
    let mut noise = NoiseEstimator::default();
    let map = |p: usize, noise: NoiseEstimator, position: &Position| {
        debug_assert_eq!(position.channels, channels);
        (noise, block.map(|block| (boards[p], light::smoothed(position, block))))
    };
    let take = |wave: Vec<_>| {
        for (n, view) in wave {
            noise.merge(&n);
            if let (Some(views), Some((board, image))) = (&mut views, view) {
                views.push(&board, image);
            }
        }
    };
    placed.sweep.stream(&which, progress, NoiseEstimator::add, map, take)?;
    let lsb = 1.0 / (rig.saturation - rig.black_level).max(1e-9);
    placed.noise = noise.finish(lsb as f32);
    Ok(views)
}

/// The numbers by which a checkpoint knows its camera again.
pub fn camera_key(camera: &Camera) -> Vec<f64> {
    let mut key = vec![camera.width as f64, camera.height as f64, camera.fx, camera.fy, camera.cx, camera.cy];
    key.extend_from_slice(camera.distortion.coeffs());
    key
}
