//! From a board sweep to a color field (method.md §1): read and normalize, find the boards, find where the light comes
//! from, fit c, and measure it at positions that it has not seen.

pub mod dark;
pub mod light;
pub mod noise;
pub mod projector;
pub mod sweep;

use std::path::PathBuf;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::board::{BoardError, Detector};
use nelu3d_scan::pose::{PoseError, Trajectory, TrajectoryModel};
use nelu3d_scan::rig::{PatternSet, RigError, Shot};
use nelu3d_scan::{Camera, Rig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::color_field::bins::Bins;
use crate::color_field::fit::{Smoothness, fit};
use crate::color_field::frame::{Center, Frame};
use crate::color_field::grid::Grid;
use crate::color_field::hash::{HashForm, HashSettings};
use crate::color_field::validity::Validity;
use crate::color_field::{About, ColorField, Form, Quality};
use crate::progress::Progress;
use crate::result::{StageClock, StageTime};
use dark::{DarkEstimator, DarkLevel};
use noise::{NoiseEstimator, NoiseModel};
use sweep::{PositionBuilder, Sweep};

/// How c is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum FormKind {
    /// Cubic B-spline over the frame, fitted by least squares.
    Grid,
    /// Multiresolution hash encoding and a small network.
    Hash,
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
            frame: FrameKind::Auto,
            trajectory: TrajectoryKind::Auto,
            hold_out: 8,
            min_contrast: 0.02,
            seed: 0,
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
    /// Pixels averaged into one sample, along a side.
    pub block: usize,
    /// What took how long.
    pub stages: Vec<StageTime>,
}

/// Most bytes that a sweep may take in memory, normalized; larger ones are averaged over blocks of pixels.
const SWEEP_BUDGET: usize = 1 << 30;
/// Most bytes of images in memory while a sweep is read.
const READ_BUDGET: usize = 1 << 30;
/// Most coefficients of a field: 24 million in f16 are 48 MB.
const MAX_COEFFS: usize = 24_000_000;

/// Calibrates a rig for one pattern set.
pub fn run(rig: &Rig, set: &PatternSet, opts: &Options, progress: &Progress) -> Result<(ColorField, Report), Error> {
    if opts.from_projector {
        return projector::run(rig, set, opts, progress);
    }
    let mut clock = StageClock::new(progress);
    let board = rig.board.as_ref().ok_or_else(|| Error::NoBoard(rig.root.join("rig.toml")))?;
    let detector = Detector::new(board)
        .map_err(|source| Error::Board { path: rig.root.join("rig.toml"), source })?
        .with_camera(&rig.camera);
    let shots = rig.positions()?;
    let folder = rig.root.join("calibration");
    if shots.len() < 3 {
        return Err(Error::TooFew { path: folder, found: shots.len(), reasons: String::new() });
    }

    clock.begin("read the sweep and find the boards");
    let (sweep, found, noise, dark) = read_sweep(rig, set, &shots, &detector, opts, progress)?;

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
    let (sweep, poses) = join(sweep, &trajectory);
    if poses.len() < 3 {
        let reasons = trajectory.rejected.iter().map(|r| format!("; {}: {}", r.position, r.reason)).collect();
        return Err(Error::TooFew { path: folder, found: poses.len(), reasons });
    }
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    let sweep = Placed::new(sweep, poses, rig.camera.clone(), board.extent_mm, noise);
    let n_usable = sweep.count_usable();
    if n_usable < 1000 {
        return Err(Error::NoSamples { path: folder, reason: sweep.why_unusable(opts.min_contrast) });
    }
    let (mut field, mut report) = from_sweep(&sweep, opts, progress, &mut clock)?;
    field.about.dark = dark;
    field.about.rig = rig.name.clone();
    field.about.set = set.name.clone();
    field.about.images = set.images.clone();
    report.trajectory = Some(trajectory);
    report.stages = clock.finish();
    Ok((field, report))
}

/// What detection said of each position.
type Found = Vec<(String, Result<Vec<nelu3d_scan::board::Corner>, String>)>;

/// Reads every image of the sweep once, in parallel over positions (over fewer of them the larger the images are).
fn read_sweep(
    rig: &Rig,
    set: &PatternSet,
    shots: &[Shot],
    detector: &Detector,
    opts: &Options,
    progress: &Progress,
) -> Result<(Sweep, Found, NoiseModel, Vec<DarkLevel>), Error> {
    let channels = rig.channels.count();
    let k = set.images.len() * channels;
    let n = rig.camera.n_pixels();
    let block = Sweep::block_for(n, k, channels, shots.len(), SWEEP_BUDGET);
    let at_once = (READ_BUDGET / (n * channels * 4 * 4 + n * k * 4)).clamp(1, rayon::current_num_threads());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(at_once).build().expect("a thread pool starts");
    let done = std::sync::atomic::AtomicUsize::new(0);
    let sensor = std::sync::Mutex::new((NoiseEstimator::default(), DarkEstimator::default()));
    let read = |shot: &Shot| -> Result<_, Error> {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        let mut reader = rig.reader(shot);
        let white = reader.read(&rig.white)?;
        let black = reader.read(&rig.black)?;
        let corners = detector.detect(&white.to_gray(), white.width, white.height).map_err(|e| e.to_string());
        let (mut noise, mut dark) = (NoiseEstimator::default(), DarkEstimator::default());
        noise.add(&white);
        dark.add(&white, &black, opts.min_contrast);
        let mut builder = PositionBuilder::new(white, black, k, opts.min_contrast);
        for name in &set.images {
            let pattern = reader.read(name)?;
            noise.add(&pattern);
            builder.add(&pattern);
        }
        {
            // Integer counts and sums of the same pixels: the order of merging only touches the last bits of sums.
            let mut sensor = sensor.lock().expect("no thread panics while it holds this");
            sensor.0.merge(&noise);
            sensor.1.merge(&dark);
        }
        let position = builder.finish(shot.name.clone(), block);
        progress.tick(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, shots.len());
        Ok((position, (shot.name.clone(), corners)))
    };
    let parts: Vec<_> = pool.install(|| shots.par_iter().map(read).collect::<Result<Vec<_>, Error>>())?;
    let (positions, found) = parts.into_iter().unzip();
    let lsb = 1.0 / (rig.saturation - rig.black_level).max(1e-9);
    let (noise, dark) = sensor.into_inner().expect("no thread panics while it holds this");
    let (noise, dark) = (noise.finish(lsb as f32), dark.finish());
    let sweep =
        Sweep { width: rig.camera.width / block, height: rig.camera.height / block, block, k, channels, positions };
    Ok((sweep, found, noise, dark))
}

/// Keeps the positions that have a pose, in order.
fn join(mut sweep: Sweep, trajectory: &Trajectory) -> (Sweep, Vec<Isometry3<f64>>) {
    let pose_of = |name: &str| trajectory.positions.iter().find(|p| p.position == name).map(|p| p.cam_from_board);
    let poses = sweep.positions.iter().filter_map(|p| pose_of(&p.name)).collect();
    sweep.positions.retain(|p| pose_of(&p.name).is_some());
    (sweep, poses)
}

/// A sweep whose boards are known: samples of (x, L).
pub struct Placed {
    /// The intensities.
    pub sweep: Sweep,
    /// Board poses, one per position.
    pub poses: Vec<Isometry3<f64>>,
    /// The camera.
    pub camera: Camera,
    /// Outline of the board, mm.
    pub extent_mm: [f64; 4],
    /// The sensor's noise.
    pub noise: NoiseModel,
    /// Unit ray direction per sample of the image.
    dirs: Vec<Vector3<f64>>,
}

impl Placed {
    /// Joins intensities and poses.
    pub fn new(
        sweep: Sweep,
        poses: Vec<Isometry3<f64>>,
        camera: Camera,
        extent_mm: [f64; 4],
        noise: NoiseModel,
    ) -> Self {
        assert_eq!(sweep.positions.len(), poses.len());
        let dirs = (0..sweep.n())
            .into_par_iter()
            .map(|i| camera.ray(sweep.px(i % sweep.width, i / sweep.width)).dir)
            .collect();
        Self { sweep, poses, camera, extent_mm, noise, dirs }
    }

    /// Distance along the ray of sample `i` to the board at position `p`, mm; `None` outside the board.
    #[inline]
    fn hit(&self, p: usize, i: usize) -> Option<f64> {
        let pose = &self.poses[p];
        let normal = pose.rotation * Vector3::z();
        let t = normal.dot(&pose.translation.vector) / normal.dot(&self.dirs[i]);
        if !(t.is_finite() && t > 0.0) {
            return None;
        }
        let on = pose.inverse_transform_point(&Point3::from(self.dirs[i] * t));
        let [x0, y0, x1, y1] = self.extent_mm;
        (on.x >= x0 && on.x <= x1 && on.y >= y0 && on.y <= y1).then_some(t)
    }

    /// Calls `f(sample index, t, values, weights)` for every usable sample of a position.
    fn for_each(&self, p: usize, mut f: impl FnMut(usize, f64, &[f32], &[f32])) {
        let (mut v, mut w) = (vec![0.0; self.sweep.k], vec![0.0; self.sweep.k]);
        for i in 0..self.sweep.n() {
            if let Some(t) = self.hit(p, i)
                && self.sweep.sample(p, i, &self.noise, &mut v, &mut w)
            {
                f(i, t, &v, &w);
            }
        }
    }

    fn count_usable(&self) -> usize {
        (0..self.poses.len())
            .into_par_iter()
            .map(|p| {
                let mut n = 0;
                self.for_each(p, |_, _, _, _| n += 1);
                n
            })
            .sum()
    }

    fn why_unusable(&self, min_contrast: f32) -> String {
        format!(
            "no pixel of the board is usable in any position: white − black is below {:.0} % of full scale or an image is \
             clipped everywhere; check exposure, `saturation` and `black_level`, and that white.png is the flash",
            min_contrast * 100.0
        )
    }
}

/// Fits a color field to a placed sweep and measures it at held-out positions.
pub fn from_sweep(
    placed: &Placed,
    opts: &Options,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<(ColorField, Report), Error> {
    clock.begin("find the light");
    let sweep = &placed.sweep;
    let n_positions = sweep.positions.len();
    let center = match opts.frame {
        FrameKind::Camera => None,
        _ => light::find_center(sweep, &placed.poses, &placed.camera, Vector3::x()),
    };
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
        tries.push(Fit::new(placed, frame, Center::Light, &held, opts, progress));
        let q = &tries[0].quality;
        tracing::debug!(psnr = q.psnr_db, ceiling = q.ceiling_db, "field in the light's frame");
    }
    let light_is_good = tries.first().is_some_and(|t| t.quality.psnr_db > t.quality.ceiling_db - 3.0);
    if tries.is_empty() || (opts.frame == FrameKind::Auto && !light_is_good) {
        let middle = Point3::from(placed.mean_point());
        let frame = Frame::around(Point3::origin(), middle, Vector3::x());
        tries.push(Fit::new(placed, frame, Center::Camera, &held, opts, progress));
    }
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    let best = tries
        .into_iter()
        .max_by(|a, b| a.quality.psnr_db.total_cmp(&b.quality.psnr_db))
        .expect("at least one frame was tried");

    clock.begin("fit the field to all positions");
    let Fit { frame, center: kind, cells, mut form, mut bins, quality } = best;
    for p in &held {
        add_position(placed, &frame, *p, &mut bins);
    }
    match &mut form {
        Form::Grid(grid) => fit(grid, &bins, smoothness(kind), 12, progress),
        Form::Hash(hash) => hash.train(&bins, opts.seed.wrapping_add(1), progress),
    }
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    clock.begin("mark the calibrated volume");
    let validity = validity(placed, &frame, cells);
    let step_mm = placed.typical_step_mm();
    let about = About {
        version: env!("CARGO_PKG_VERSION").into(),
        rig: String::new(),
        set: String::new(),
        images: Vec::new(),
        channels: sweep.channels,
        center: kind,
        source: "sweep".into(),
        camera: camera_key(&placed.camera),
        noise: placed.noise,
        dark: Vec::new(),
        step_mm,
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
        block: sweep.block,
        stages: Vec::new(),
    };
    Ok((ColorField { frame, form, validity, about }, report))
}

/// The numbers by which a checkpoint knows its camera again.
pub fn camera_key(camera: &Camera) -> Vec<f64> {
    let mut key = vec![camera.width as f64, camera.height as f64, camera.fx, camera.fy, camera.cx, camera.cy];
    key.extend_from_slice(camera.distortion.coeffs());
    key
}

impl Placed {
    fn mean_point(&self) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        let mut n = 0.0;
        for p in 0..self.poses.len() {
            for i in (0..self.sweep.n()).step_by((self.sweep.n() / 500).max(1)) {
                if let Some(t) = self.hit(p, i) {
                    sum += self.dirs[i] * t;
                    n += 1.0;
                }
            }
        }
        if n > 0.0 { sum / n } else { Vector3::new(0.0, 0.0, 1.0) }
    }

    /// Median distance between neighboring boards along the central ray of what they cover.
    fn typical_step_mm(&self) -> f64 {
        let dir = self.mean_point().normalize();
        let mut t: Vec<f64> = self
            .poses
            .iter()
            .map(|p| {
                let n = p.rotation * Vector3::z();
                n.dot(&p.translation.vector) / n.dot(&dir)
            })
            .collect();
        t.sort_by(f64::total_cmp);
        let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps[steps.len() / 2]
    }
}

/// A field fitted without the held-out positions.
struct Fit {
    frame: Frame,
    center: Center,
    cells: [usize; 3],
    form: Form,
    bins: Bins,
    quality: Quality,
}

fn smoothness(center: Center) -> Smoothness {
    match center {
        Center::Light => Smoothness { across: 3e-4, along: 3e-3 },
        Center::Camera => Smoothness { across: 3e-3, along: 1e-4 },
    }
}

impl Fit {
    fn new(
        placed: &Placed,
        mut frame: Frame,
        center: Center,
        held: &[usize],
        opts: &Options,
        progress: &Progress,
    ) -> Self {
        let sweep = &placed.sweep;
        for p in 0..placed.poses.len() {
            for i in (0..sweep.n()).step_by(7) {
                if let Some(t) = placed.hit(p, i) {
                    frame.enclose(&Point3::from(placed.dirs[i] * t));
                }
            }
        }
        // A hair of margin: the box was found from every seventh sample.
        for i in 0..3 {
            let margin = 0.01 * (frame.hi[i] - frame.lo[i]);
            frame.lo[i] -= margin;
            frame.hi[i] += margin;
        }
        let cells = resolution(placed, &frame, center);
        let k = sweep.k;
        let along = match center {
            Center::Light => cells[2] * 3,
            Center::Camera => cells[2] * 2,
        };
        let mut bins = Bins::new([cells[0], cells[1], along], k);
        for p in (0..placed.poses.len()).filter(|p| !held.contains(p)) {
            add_position(placed, &frame, p, &mut bins);
        }
        let form = match opts.form {
            FormKind::Grid => {
                // Coarse to fine: the coarse fit fills what the fine one cannot see.
                let mut grid = Grid::new([cells[0] / 4 + 1, cells[1] / 4 + 1, cells[2]], k);
                let coarse = bins.merged([cells[0] / 4 + 1, cells[1] / 4 + 1, along]);
                fit(&mut grid, &coarse, smoothness(center), 30, progress);
                let mut grid = grid.resampled(cells);
                fit(&mut grid, &bins, smoothness(center), 20, progress);
                Form::Grid(grid)
            }
            FormKind::Hash => {
                let mut hash = HashForm::new(HashSettings::for_cells(cells), k, opts.seed);
                hash.train(&bins, opts.seed, progress);
                Form::Hash(Box::new(hash))
            }
        };
        let quality = match &form {
            Form::Grid(g) => measure(placed, &frame, g, held),
            Form::Hash(h) => measure(placed, &frame, &h.to_grid(), held),
        };
        Self { frame, center, cells, form, bins, quality }
    }
}

fn add_position(placed: &Placed, frame: &Frame, p: usize, bins: &mut Bins) {
    placed.for_each(p, |i, t, v, w| {
        if let Some(q) = frame.to_unit(&Point3::from(placed.dirs[i] * t)) {
            bins.add(q, v, w);
        }
    });
}

/// Cells along a, b and w: across, one per sample of the image where the volume is; along, what the sweep can supervise.
fn resolution(placed: &Placed, frame: &Frame, center: Center) -> [usize; 3] {
    let sweep = &placed.sweep;
    let n_positions = placed.poses.len();
    let mid = Point3::from(placed.mean_point());
    // Pitch of samples at the middle of the volume, in the frame's units.
    let px = placed.camera.project(&mid).unwrap_or([placed.camera.cx, placed.camera.cy]);
    let b = sweep.block as f64;
    let at = |dx: f64, dy: f64| {
        let dir = placed.camera.ray([px[0] + dx * b, px[1] + dy * b]).dir;
        frame.to_abw(&Point3::from(dir * (mid.z / dir.z))).unwrap_or([0.0; 3])
    };
    let (o, r, d) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0));
    let pitch_a = (r[0] - o[0]).hypot(d[0] - o[0]).max(1e-9);
    let pitch_b = (r[1] - o[1]).hypot(d[1] - o[1]).max(1e-9);
    let span = |i: usize| frame.hi[i] - frame.lo[i];
    let along = match center {
        // Only defocus changes along a ray of light.
        Center::Light => (n_positions / 4).clamp(1, 4),
        Center::Camera => n_positions - 1,
    };
    let mut cells = [(span(0) / pitch_a).ceil() as usize, (span(1) / pitch_b).ceil() as usize, along];
    let nodes = |c: [usize; 3]| c.iter().map(|c| c + 3).product::<usize>() * sweep.k;
    let shrink = (MAX_COEFFS as f64 / nodes(cells) as f64).sqrt().min(1.0);
    for c in &mut cells[..2] {
        *c = ((*c as f64 * shrink) as usize).max(4);
    }
    cells
}

/// Compares a field with the samples of positions it was not made from.
fn measure(placed: &Placed, frame: &Frame, grid: &Grid, held: &[usize]) -> Quality {
    let k = placed.sweep.k;
    #[derive(Default, Clone)]
    struct Sums {
        all: (f64, usize),
        lit: (f64, usize),
        noise: f64,
        depth: Vec<f32>,
    }
    let parts: Vec<Sums> = held
        .par_iter()
        .map(|p| {
            let mut s = Sums::default();
            let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
            let mut n = 0usize;
            placed.for_each(*p, |i, t, v, w| {
                let m = frame.along_ray(&placed.dirs[i]).at(t);
                grid.eval_along(m.q, m.dq, &mut c, &mut d);
                let (mut h, mut g) = (0.0, 0.0);
                for j in 0..k {
                    if w[j] == 0.0 {
                        continue;
                    }
                    let e = c[j] - v[j];
                    s.all.0 += f64::from(e * e);
                    s.all.1 += 1;
                    let contrast = placed.sweep.positions[*p].contrast
                        [i * placed.sweep.channels + j % placed.sweep.channels]
                        .to_f32();
                    if contrast >= 0.1 {
                        s.lit.0 += f64::from(e * e);
                        s.lit.1 += 1;
                        s.noise += f64::from(1.0 / w[j]);
                    }
                    h += w[j] * d[j] * d[j];
                    g += w[j] * d[j] * e;
                }
                n += 1;
                if n.is_multiple_of(16) && h > 0.0 {
                    s.depth.push((g / h).abs());
                }
            });
            s
        })
        .collect();
    let mut t = Sums::default();
    for s in parts {
        t.all = (t.all.0 + s.all.0, t.all.1 + s.all.1);
        t.lit = (t.lit.0 + s.lit.0, t.lit.1 + s.lit.1);
        t.noise += s.noise;
        t.depth.extend(s.depth);
    }
    let db = |sum: f64, n: usize| if n > 0 { -10.0 * (sum / n as f64).log10() } else { f64::NAN };
    t.depth.sort_by(f32::total_cmp);
    let (lit, noise) =
        if t.lit.1 > 0 { (db(t.lit.0, t.lit.1), db(t.noise, t.lit.1)) } else { (db(t.all.0, t.all.1), 60.0) };
    Quality {
        held_out: held.iter().map(|p| placed.sweep.positions[*p].name.clone()).collect(),
        n: t.all.1,
        psnr_db: lit,
        psnr_all_db: db(t.all.0, t.all.1),
        ceiling_db: noise,
        depth_mm: t.depth.get(t.depth.len() / 2).copied().unwrap_or(f32::NAN).into(),
    }
}

/// Where samples were: ranges along the rays of tiles of pixels, and lit cells of the frame.
fn validity(placed: &Placed, frame: &Frame, cells: [usize; 3]) -> Validity {
    const TILE: usize = 8;
    let lit = [(cells[0] / 4).max(1), (cells[1] / 4).max(1), (placed.poses.len() / 2).clamp(1, 32)];
    let mut v = Validity::new(placed.camera.width, placed.camera.height, TILE.max(placed.sweep.block), lit);
    for p in 0..placed.poses.len() {
        placed.for_each(p, |i, t, _, _| {
            let px = placed.sweep.px(i % placed.sweep.width, i / placed.sweep.width);
            if let Some(q) = frame.to_unit(&Point3::from(placed.dirs[i] * t)) {
                v.add(px, t as f32, q);
            }
        });
    }
    v.close();
    v
}
