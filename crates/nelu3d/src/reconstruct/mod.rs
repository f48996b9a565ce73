//! From a color field and the captures of a scene to a surface. Recipe [`paper`] is the published one; recipe `fast` is:
//!
//! Measure (normalize, mask) → decode (cost volume, aggregation) → refine (narrow-band volume rendering) → filter → surface.

pub mod assemble;
pub mod decode;
mod effort;
mod indirect;
pub mod lookup;
pub mod measure;
mod mixing;
mod observer;
pub mod paper;
pub mod refine;
mod shares;
pub(crate) mod smooth;
pub mod surface;
mod thin_plate;
mod uncertainty;
mod warm;
mod window;

use std::collections::VecDeque;
use std::path::PathBuf;

use nelu3d_field::device::{Choice, Device, DeviceError};
use nelu3d_scan::rig::{Capture, PatternSet, RigError, Shot};
use nelu3d_scan::{Camera, Rig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::calibrate::camera_key;
use crate::color_field::ColorField;
use crate::progress::Progress;
use crate::result::{Left, Reconstruction, StageClock};
use assemble::{MAX_SLOPE, Maps, assemble};
use decode::{DecodeSettings, decode, depth_hypotheses};
pub use effort::{Effort, EffortSettings};
use lookup::{Lookup, Rays};
use measure::{Measurements, SharesPrior};
pub use mixing::Mixing;
pub use observer::{Observer, Stage};
use refine::{RefineSettings, refine};
use surface::Links;

/// How the surface is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Recipe {
    /// Cost volume, then narrow-band volume rendering
    Fast,
    /// As published: a hash-encoded signed distance field trained from scratch, 10,000 iterations
    Paper,
}

/// What is done about channels of the camera that see each other's light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum CrossTalk {
    /// Taken out of color images; how much there is comes from the color field or, without it there, from the scene
    #[default]
    Auto,
    /// Left in
    Off,
}

/// Settings of a reconstruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// How the surface is found
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Recipe::Fast))]
    pub recipe: Recipe,
    /// Seed of everything random
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0))]
    pub seed: u64,
    /// How much work to put in
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Effort::Normal))]
    pub effort: Effort,
    /// Steps of the narrow-band refinement (default: by effort), or iterations of recipe `paper` (default: 10000)
    #[cfg_attr(feature = "clap", arg(long, value_name = "N"))]
    pub steps: Option<usize>,
    /// Most depth labels of the cost volume
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 512))]
    pub max_labels: usize,
    /// Least roughness of the surface: typical second difference between neighboring pixels, in px of disparity; smaller
    /// is smoother
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.14))]
    pub roughness: f32,
    /// Smallest connected piece of surface that is kept, px
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 40))]
    pub min_component: usize,
    /// What to do about camera channels that see each other's light (recipe `fast`, color cameras)
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = CrossTalk::Auto))]
    pub cross_talk: CrossTalk,
    /// Where the heavy work is done: auto (a GPU, if there is one), cpu, gpu, or gpu:N as in `nelu3d devices`
    #[serde(skip)]
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Choice::Auto))]
    pub device: Choice,
    /// Settings of recipe `paper`.
    #[cfg_attr(feature = "clap", command(flatten))]
    pub paper: paper::PaperOptions,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            recipe: Recipe::Fast,
            seed: 0,
            effort: Effort::Normal,
            steps: None,
            max_labels: 512,
            roughness: 0.14,
            min_component: 40,
            cross_talk: CrossTalk::Auto,
            device: Choice::Cpu,
            paper: paper::PaperOptions::default(),
        }
    }
}

/// Why a reconstruction failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The rig folder or one of its images.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The field was made for something else.
    #[error("the color field was made for {what} {theirs}, but the rig has {ours}: {remedy}")]
    Mismatch {
        /// What differs.
        what: &'static str,
        /// The field's.
        theirs: String,
        /// The rig's.
        ours: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The device that was asked for is not there.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Nothing can be reconstructed.
    #[error("{path}: no pixel can be reconstructed: {reason}")]
    Nothing {
        /// The scene's folder.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The user stopped it.
    #[error("stopped before the surface was finished; nothing was written")]
    Cancelled,
}

/// Reconstructs a scene of a rig.
pub fn run(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    field: &ColorField,
    opts: &Options,
    progress: &Progress,
) -> Result<Reconstruction, Error> {
    run_observed(rig, set, shot, field, opts, progress, None)
}

/// Reconstructs a scene of a rig while somebody watches. The result is the same.
pub fn run_observed(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    field: &ColorField,
    opts: &Options,
    progress: &Progress,
    observer: Option<&mut dyn Observer>,
) -> Result<Reconstruction, Error> {
    check_field(rig, set, field)?;
    Device::open(opts.device)?;
    let mut clock = StageClock::new(progress);
    clock.begin("read the scene");
    let capture = rig.read_shot(shot, set, nelu3d_scan::rig::Need::Scene)?;
    check_mono(&capture, set, shot, field)?;
    let recipe = match opts.recipe {
        Recipe::Fast => reconstruct,
        Recipe::Paper => paper::reconstruct,
    };
    let mut out =
        recipe(&capture, &rig.camera, field, opts, progress, &mut clock, observer).map_err(|reason| reason.at(shot))?;
    out.stages = clock.finish();
    Ok(out)
}

/// Whether a color field belongs to a rig and pattern set.
///
/// # Errors
///
/// [`Error::Mismatch`]: it was made for another camera or other patterns.
pub fn check_field(rig: &Rig, set: &PatternSet, field: &ColorField) -> Result<(), Error> {
    const AGAIN: &str = "run `nelu3d calibrate` for this rig and set, or pass the right --field";
    if camera_key(&rig.camera) != field.about.camera {
        let show = |k: &[f64]| format!("{} × {} px, f = {:.1} px", k[0], k[1], k[2]);
        let (theirs, ours) = (show(&field.about.camera), show(&camera_key(&rig.camera)));
        return Err(Error::Mismatch { what: "the camera", theirs, ours, remedy: AGAIN });
    }
    if field.about.images != set.images || field.k() != set.images.len() * rig.channels.count() {
        let show = |name: &str, images: &[String]| format!("`{name}` ({})", images.join(", "));
        let (theirs, ours) = (show(&field.about.set, &field.about.images), show(&set.name, &set.images));
        return Err(Error::Mismatch { what: "the pattern set", theirs, ours, remedy: AGAIN });
    }
    Ok(())
}

/// Whether the mono images among a scene's patterns are those that were mono in the sweep: their codewords are others.
///
/// # Errors
///
/// [`Error::Mismatch`]: a pattern has another number of channels than it had.
pub fn check_mono(capture: &Capture, set: &PatternSet, shot: &Shot, field: &ColorField) -> Result<(), Error> {
    // A field computed from projected images has seen none.
    let made_of_images = field.about.source == "sweep";
    for (name, mono) in set.images.iter().zip(&capture.mono) {
        if made_of_images && field.about.mono.contains(name) != *mono {
            let (now, then) = if *mono { ("one channel", "three") } else { ("three channels", "one") };
            let ours = format!("{} with {now}", shot.dir.join(name).display());
            let remedy = "take this pattern the same way in the sweep and in scenes";
            return Err(Error::Mismatch { what: "the image", theirs: format!("`{name}` with {then}"), ours, remedy });
        }
    }
    Ok(())
}

/// Why [`reconstruct`] has no result.
#[derive(Debug)]
pub enum Failure {
    /// Every pixel was left out.
    Nothing(String),
    /// The user stopped it.
    Cancelled,
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Failure::Nothing(reason) => write!(f, "no pixel can be reconstructed: {reason}"),
            Failure::Cancelled => write!(f, "stopped before the surface was finished"),
        }
    }
}

impl Failure {
    fn at(self, shot: &Shot) -> Error {
        match self {
            Failure::Nothing(reason) => Error::Nothing { path: shot.dir.clone(), reason },
            Failure::Cancelled => Error::Cancelled,
        }
    }
}

/// What a pixel measured, and where its decoded surface point is.
pub(crate) struct Codeword {
    /// Camera-frame point, mm.
    pub(crate) point: [f64; 3],
    /// k normalized intensities; NaN where a channel is unusable.
    pub(crate) intensities: Vec<f32>,
}

/// Decoded points and their codewords, without refinement: only pixels in surroundings that agree.
pub(crate) fn codewords(capture: &Capture, camera: &Camera, field: &ColorField) -> Vec<Codeword> {
    let mut m = Measurements::new(capture, &field.about.noise, &field.about.dark, 0.05);
    let shares = SharesPrior { sigma_ambient: 0.03, sigma_indirect: 0.1 };
    let opts = Options { min_component: 50, ..Options::default() };
    let rays = Rays::new(camera, field, 1);
    let grid = field.to_grid();
    let decoded = start_pieces(
        &mut m,
        &rays,
        &Lookup::new(&grid, field.about.fineness),
        field,
        camera,
        shares,
        MOST_CODEWORDS,
        &opts,
    );
    let k = m.k;
    (0..m.n())
        .filter(|i| decoded.0[*i].is_finite())
        .map(|i| {
            let z = 1.0 / f64::from(decoded.0[i]);
            let [u, v] = rays.plane[i].map(f64::from);
            let intensities =
                (i * k..(i + 1) * k).map(|j| if m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN }).collect();
            Codeword { point: [u * z, v * z, z], intensities }
        })
        .collect()
}

/// Most pixels that [`codewords`] decodes: a sample is enough.
const MOST_CODEWORDS: usize = 100_000;

/// Standard deviation of what the color field itself gets wrong, in normalized intensity.
fn model_sigma(field: &ColorField) -> f32 {
    // What the held-out positions show beyond their own noise, and at least half a percent: interreflection, sensor
    // nonlinearity and the like never vanish.
    let q = field.about.quality.as_ref();
    let excess = q.map_or(1e-4, |q| (10f64.powf(-q.psnr_db / 10.0) - 10f64.powf(-q.ceiling_db / 10.0)).max(0.0));
    (excess.sqrt() as f32).max(0.005)
}

/// Reconstructs a capture.
pub fn reconstruct(
    capture: &Capture,
    camera: &Camera,
    field: &ColorField,
    opts: &Options,
    progress: &Progress,
    clock: &mut StageClock<'_>,
    observer: Option<&mut dyn Observer>,
) -> Result<Reconstruction, Failure> {
    reconstruct_after(None, capture, camera, field, opts, progress, clock, observer)
}

/// What is known of a scene from a moment earlier.
#[derive(Clone, Debug)]
pub struct Before {
    /// Camera z per pixel, mm; NaN where there was no surface.
    pub depth: Vec<f32>,
    /// How the camera mixes the light's colors.
    pub mixing: Option<Mixing>,
}

/// Reconstructs a capture of a scene whose surface a moment earlier is known. Where nothing near the old surface explains
/// what is seen, or all in all too little, it is found from nothing.
#[allow(clippy::too_many_arguments)]
pub fn reconstruct_after(
    before: Option<&Before>,
    capture: &Capture,
    camera: &Camera,
    field: &ColorField,
    opts: &Options,
    progress: &Progress,
    clock: &mut StageClock<'_>,
    mut observer: Option<&mut dyn Observer>,
) -> Result<Reconstruction, Failure> {
    let mut effort = opts.effort.settings();
    effort.steps = opts.steps.unwrap_or(effort.steps);
    // Normalize and mask.
    clock.begin("prepare");
    let grid = field.to_grid();
    let channels = capture.white.channels;
    let mut m = Measurements::new(capture, &field.about.noise, &field.about.dark, model_sigma(field));
    let lookup = Lookup::new(&grid, field.about.fineness);
    let rays = Rays::new(camera, field, 1);
    let stop = || if progress.cancelled() { Err(Failure::Cancelled) } else { Ok(()) };
    stop()?;

    // Decode, in a smaller picture if this one is large.
    clock.begin("decode the cost volume");
    let shares = SharesPrior { sigma_ambient: 0.05, sigma_indirect: 0.2 };
    let board = board_color(field, &m).filter(|_| opts.cross_talk == CrossTalk::Auto);
    let taken = board.is_some().then(|| m.clone());
    let mut mixing = field.about.mixing.or(before.and_then(|b| b.mixing)).unwrap_or(Mixing::NONE);
    if let Some(board) = board.as_ref().filter(|_| mixing != Mixing::NONE) {
        m.unmix(&mixing, board);
    }
    let warm = before.and_then(|before| {
        start_warm(&before.depth, &mut m, &rays, &lookup, field, camera, shares, effort.decoded_pixels, opts)
    });
    let redone = warm.as_ref().map(|w| w.redone);
    let is_warm = redone.is_some();
    let (start, unit) = match warm {
        Some(w) => {
            effort = opts.effort.warm();
            effort.steps = opts.steps.unwrap_or(effort.steps);
            (w.inv_z, w.unit)
        }
        None => {
            let mut found = start(&mut m, &rays, &lookup, field, camera, shares, effort.decoded_pixels, opts);
            if let (Some(board), Some(taken), None) = (&board, &taken, field.about.mixing) {
                // Surface and mixing by turns: each is better with a better other.
                for _ in 0..MIXING_ROUNDS {
                    let found_now = mixing::estimate(taken, &found.0, &rays, &lookup, board, &mixing);
                    // Without evidence for cross-talk there is none: what is systematic for other reasons is not to be bent into it.
                    let Some(better) = found_now.filter(|e| e.explained > MIXING_EVIDENCE).map(|e| e.mixing) else {
                        break;
                    };
                    let change = better.difference(&mixing);
                    if change < MIXING_SETTLED {
                        break;
                    }
                    mixing = better;
                    m = taken.clone();
                    m.unmix(&mixing, board);
                    found = start(&mut m, &rays, &lookup, field, camera, shares, effort.decoded_pixels, opts);
                }
            }
            found
        }
    };
    if start.iter().all(|z| z.is_nan()) {
        return Err(Failure::Nothing(why_nothing(&m.left)));
    }
    stop()?;

    if let Some(o) = observer.as_deref_mut() {
        clock.pause();
        o.surface(Stage::Decode, 1, &start.iter().map(|v| 1.0 / v).collect::<Vec<_>>());
    }

    // Refine.
    clock.begin("refine the surface");
    let settings = RefineSettings {
        steps: effort.steps,
        settled: if is_warm { SETTLED } else { 0.0 },
        first_width_mm: 0.7,
        last_width_mm: 0.1,
        loosened: if is_warm { 4.0 } else { 1.0 },
        patches: effort.patches,
        gathers: effort.gathers,
        first_gather: if is_warm { 0 } else { 2 },
        shares,
        ambient_radius: (m.width / 80).max(2),
        // A label is 0.7 px of disparity.
        roughness: opts.roughness / 0.7,
    };
    let refined = refine(&m, &rays, &lookup, &start, unit, channels, &settings, progress, &mut |step, depth| {
        if let Some(o) = observer.as_deref_mut() {
            clock.pause();
            o.surface(Stage::Refine, step + 1, &depth());
            clock.resume();
        }
    });
    stop()?;

    // Leave out what has no consistent code.
    clock.begin("filter");
    let n = m.n();
    let mut depth: Vec<f32> = refined.inv_z.iter().map(|v| 1.0 / v).collect();
    let misfit = local_mean(&refined.chi2, m.width, m.height, 2);
    for i in 0..n {
        if !depth[i].is_finite() {
            continue;
        }
        let [near, far] = rays.range[i];
        let t = depth[i] / rays.dir_z(i);
        if !(t >= near && t <= far) {
            m.left[i] = Left::Outside;
        } else if misfit[i] > MAX_MISFIT {
            m.left[i] = Left::Ambiguous;
        } else {
            continue;
        }
        depth[i] = f32::NAN;
    }
    let links = Links::new(&depth, camera, MAX_SLOPE);
    for i in links.at_jumps(&depth, m.width) {
        if refined.chi2[i] > MAX_EDGE_MISFIT {
            m.left[i] = Left::Edge;
            depth[i] = f32::NAN;
        }
    }
    let links = Links::new(&depth, camera, MAX_SLOPE);
    let sizes = links.component_sizes(&depth, m.width);
    for i in 0..n {
        if depth[i].is_finite() && (sizes[i] as usize) < opts.min_component {
            m.left[i] = Left::Ambiguous;
            depth[i] = f32::NAN;
        }
        if depth[i].is_nan() && m.left[i] == Left::Kept {
            // A reduced decoding does not know which of its pixels' rays miss the volume.
            let [near, far] = rays.range[i];
            m.left[i] = if near > far { Left::Outside } else { Left::Ambiguous };
        }
    }
    if depth.iter().all(|z| z.is_nan()) {
        return Err(Failure::Nothing(why_nothing(&m.left)));
    }

    if let Some(o) = observer {
        clock.pause();
        o.surface(Stage::Result, 1, &depth);
    }

    // The surface.
    clock.begin("build the surface");
    let kept = |i: usize| depth[i].is_finite();
    let sigma = (0..n)
        .map(|i| {
            if !kept(i) {
                return f32::NAN;
            }
            // From 1/z to z.
            refined.sigma[i] * depth[i] * depth[i]
        })
        .collect();
    let median_residual = {
        let mut v: Vec<f32> = (0..n).filter(|i| kept(*i)).map(|i| refined.abs_residual[i]).collect();
        let mid = v.len() / 2;
        *v.select_nth_unstable_by(mid, f32::total_cmp).1
    };
    let mut info = serde_json::Map::new();
    info.insert("settings".into(), serde_json::to_value(opts).expect("plain data serializes"));
    info.insert("effort".into(), serde_json::to_value(effort).expect("plain data serializes"));
    info.insert("device".into(), json!(Device::or_cpu(opts.device).name()));
    info.insert(
        "field".into(),
        json!({ "rig": field.about.rig, "set": field.about.set, "form": field.form_name(), "source": field.about.source }),
    );
    info.insert(
        "start".into(),
        match redone {
            Some(share) => json!({ "from": "the frame before", "found_anew": share }),
            None => json!({ "from": "nothing" }),
        },
    );
    info.insert("mixing".into(), json!(board.is_some().then_some(mixing)));
    info.insert("losses".into(), json!(refined.losses));
    info.insert("albedo".into(), json!(refined.albedo));
    info.insert("median_residual".into(), json!(median_residual));
    let maps = Maps { depth, sigma, left: m.left, residual: refined.residual, ambient: refined.ambient };
    Ok(assemble(maps, camera, &rays.plane, &capture.white, info))
}

/// Mean χ² per measurement around a pixel above which its codeword is not explained by any surface here.
const MAX_MISFIT: f32 = 40.0;
/// χ² per measurement of a pixel at a depth jump above which its codeword is taken for a mixture of two surfaces.
const MAX_EDGE_MISFIT: f32 = 9.0;

fn why_nothing(left: &[Left]) -> String {
    let count = |l: Left| left.iter().filter(|v| **v == l).count() as f64 / left.len() as f64 * 100.0;
    format!(
        "{:.0} % of the pixels are too dark, {:.0} % clipped, {:.0} % outside the calibrated volume, {:.0} % without a \
         consistent code; check the exposure and that the object stands where the board was swept",
        count(Left::Dark),
        count(Left::Clipped),
        count(Left::Outside),
        count(Left::Ambiguous)
    )
}

/// How often surface and mixing are found by turns, at most.
const MIXING_ROUNDS: usize = 3;
/// Least part of the misfit that cross-talk must explain before it is believed.
const MIXING_EVIDENCE: f32 = 0.1;
/// Entries of the mixing matrix that change by less than this no longer matter.
const MIXING_SETTLED: f32 = 0.01;

/// The color of the flash on the board, for images of three channels; `None` where the field does not know it.
fn board_color(field: &ColorField, m: &Measurements) -> Option<[f32; 3]> {
    let light: Vec<f32> = field.about.dark.iter().map(|d| d.light).collect();
    let known = m.light.len() == 3 * m.n() && light.len() == 3 && light.iter().all(|v| *v > 0.0);
    known.then(|| [light[0], light[1], light[2]])
}

/// A surface that moves by less than this in a step has settled, labels (mean over its pixels).
const SETTLED: f32 = 0.01;
/// Share of the pixels without a place near the old surface above which all are decoded anew.
const TOO_MANY_WRONG: f32 = 0.4;

/// A start from the frame before.
struct Warm {
    /// Inverse depth, 1/mm; NaN where there is none.
    inv_z: Vec<f32>,
    /// The label spacing.
    unit: f32,
    /// Share of the pixels that were decoded in the whole volume.
    redone: f32,
}

/// The start from the surface of the frame before; `None` if it says too little about this one.
#[allow(clippy::too_many_arguments)]
fn start_warm(
    before: &[f32],
    m: &mut Measurements,
    rays: &Rays,
    grid: &Lookup<'_>,
    field: &ColorField,
    camera: &Camera,
    shares: SharesPrior,
    most: usize,
    opts: &Options,
) -> Option<Warm> {
    let unit = depth_hypotheses(m, rays, grid, opts.max_labels.max(16))?.spacing;
    let noisy = decode::depth_noise(m, rays, grid).round().clamp(1.0, 4.0) as usize;
    let moved = warm::moved(m, rays, grid, &field.validity, before, unit, noisy, &shares);
    tracing::info!(wrong_share = moved.wrong_share, "start from the frame before");
    if moved.wrong_share > TOO_MANY_WRONG {
        return None;
    }
    let mut inv_z = moved.inv_z;
    if moved.wrong.iter().any(|w| *w) {
        let mut part = m.clone();
        for (left, wrong) in part.left.iter_mut().zip(&moved.wrong) {
            if *left == Left::Kept && !wrong {
                *left = Left::Dark;
            }
        }
        let (found, _) = start_pieces(&mut part, rays, grid, field, camera, shares, most, opts);
        for i in (0..inv_z.len()).filter(|i| moved.wrong[*i]) {
            if found[i].is_finite() || inv_z[i].is_nan() {
                inv_z[i] = found[i];
            }
            if part.left[i] == Left::Outside {
                m.left[i] = Left::Outside;
            }
        }
    }
    fill(&mut inv_z, &m.left, m.width);
    Some(Warm { inv_z, unit, redone: moved.wrong_share })
}

/// The start of the refinement: decoded inverse depth for every pixel that has one, and the label spacing.
fn start(
    m: &mut Measurements,
    full: &Rays,
    grid: &Lookup<'_>,
    field: &ColorField,
    camera: &Camera,
    shares: SharesPrior,
    most: usize,
    opts: &Options,
) -> (Vec<f32>, f32) {
    let (mut out, unit) = start_pieces(m, full, grid, field, camera, shares, most, opts);
    fill(&mut out, &m.left, m.width);
    (out, unit)
}

/// The decoded pieces of surface that are large enough to be believed.
fn start_pieces(
    m: &mut Measurements,
    full: &Rays,
    grid: &Lookup<'_>,
    field: &ColorField,
    camera: &Camera,
    shares: SharesPrior,
    most: usize,
    opts: &Options,
) -> (Vec<f32>, f32) {
    let settings = DecodeSettings { max_labels: opts.max_labels.max(16), p_jump: 0.01, p_step: 0.2, shares };
    let kept = m.left.iter().filter(|l| **l == Left::Kept).count();
    let too_large = (1..).find(|f| kept / (f * f) <= most).expect("some reduction is enough");
    // A noisy picture is decoded reduced as well: one pixel's codeword should tell its depth to about a label.
    let noisy = decode::depth_noise(m, full, grid).round().clamp(1.0, 4.0) as usize;
    let f = too_large.max(noisy);
    tracing::info!(reduction = f, noisy, "decode");
    let device = Device::or_cpu(opts.device);
    let (mut inv_z, unit, small_camera, small) = if f == 1 {
        let d = decode(m, full, grid, &field.validity, &settings, &device);
        (d.inv_z, d.label_step, camera.clone(), None)
    } else {
        let mut small = m.reduced(f);
        let small_rays = Rays::new(camera, field, f);
        let d = decode(&mut small, &small_rays, grid, &field.validity, &settings, &device);
        let g = f as f64;
        let half = (g - 1.0) / 2.0;
        let reduced = Camera {
            width: camera.width / f,
            height: camera.height / f,
            fx: camera.fx / g,
            fy: camera.fy / g,
            cx: (camera.cx - half) / g,
            cy: (camera.cy - half) / g,
            distortion: camera.distortion.clone(),
        };
        (d.inv_z, d.label_step, reduced, Some((small, small_rays)))
    };
    let small_pixels = |inv_z: &mut Vec<f32>, m: &Measurements, rays: &Rays| {
        settle_pieces(inv_z, m, rays, grid, &small_camera, unit, shares, opts.min_component);
    };
    match &small {
        Some((m, rays)) => small_pixels(&mut inv_z, m, rays),
        None => small_pixels(&mut inv_z, m, full),
    }
    let mut out = vec![f32::NAN; m.n()];
    let half = (f as f32 - 1.0) / 2.0;
    for (i, v) in out.iter_mut().enumerate() {
        if m.left[i] != Left::Kept {
            continue;
        }
        let at = |p: usize, n: usize| ((p as f32 - half) / f as f32).clamp(0.0, n as f32 - 1.0);
        let (sw, sh) = (small_camera.width, small_camera.height);
        *v = between(&inv_z, sw, sh, at(i % m.width, sw), at(i / m.width, sh), 3.0 * unit);
    }
    (out, unit)
}

/// A map's value between pixels: interpolated where the four around belong together (differ by no more than `most`), else
/// the nearest.
pub(crate) fn between(map: &[f32], width: usize, height: usize, x: f32, y: f32, most: f32) -> f32 {
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let four = [map[y0 * width + x0], map[y0 * width + x1], map[y1 * width + x0], map[y1 * width + x1]];
    let (lo, hi) = four.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    if four.iter().all(|v| v.is_finite()) && hi - lo <= most {
        return (four[0] * (1.0 - fx) + four[1] * fx) * (1.0 - fy) + (four[2] * (1.0 - fx) + four[3] * fx) * fy;
    }
    four[usize::from(fx > 0.5) + 2 * usize::from(fy > 0.5)]
}

/// Decides on small pieces of the decoded surface. A wrong period of the code looks like a small piece far in front of or
/// behind its surroundings; so does a small object. A piece takes over its surroundings' depth when its codewords are
/// explained there (within a few labels) nearly as well as where it was decoded. What is then still smaller than `least`
/// is left open.
#[allow(clippy::too_many_arguments)]
fn settle_pieces(
    inv_z: &mut [f32],
    m: &Measurements,
    rays: &Rays,
    grid: &Lookup<'_>,
    camera: &Camera,
    unit: f32,
    shares: SharesPrior,
    least: usize,
) {
    /// Search around the surroundings' depth, labels: a slanted surface changes that much across a piece.
    const REACH: i32 = 10;
    /// χ² that agreeing with the surroundings is worth, per pixel.
    const WORTH: f32 = 6.0;
    let depth: Vec<f32> = inv_z.iter().map(|v| 1.0 / v).collect();
    let links = Links::new(&depth, camera, MAX_SLOPE);
    let (label, sizes) = links.components(&depth, camera.width);
    let kept: u32 = sizes.iter().sum();
    let is_small: Vec<bool> = sizes.iter().map(|s| *s < kept / 50).collect();
    let mut around: Vec<f32> = inv_z.to_vec();
    for (v, l) in around.iter_mut().zip(&label) {
        if *l != u32::MAX && is_small[*l as usize] {
            *v = f32::NAN;
        }
    }
    fill(&mut around, &m.left, camera.width);
    let prior = m.shares_prior(&shares);
    let cost = |i: usize, inv_z: f32| {
        let mut c = vec![0.0; m.k];
        grid.eval(rays.in_frame(i).at(f64::from(1.0 / (inv_z * rays.dir_z(i)))).q, &mut c);
        decode::misfit(m, i, &c, prior)
    };
    // Per piece: Σ of (misfit in its surroundings − misfit where it was decoded).
    let mut excess = vec![0.0f32; sizes.len()];
    for i in 0..inv_z.len() {
        if label[i] != u32::MAX && is_small[label[i] as usize] {
            excess[label[i] as usize] += if around[i].is_nan() {
                f32::INFINITY
            } else {
                let near = (-REACH..=REACH).map(|o| cost(i, around[i] + o as f32 * unit)).fold(f32::INFINITY, f32::min);
                near - cost(i, inv_z[i])
            };
        }
    }
    for i in 0..inv_z.len() {
        if label[i] == u32::MAX {
            continue;
        }
        let l = label[i] as usize;
        if is_small[l] && excess[l] < WORTH * sizes[l] as f32 {
            inv_z[i] = around[i];
        } else if (sizes[l] as usize) < least {
            inv_z[i] = f32::NAN;
        }
    }
}

/// Fills kept pixels without a value from their nearest neighbors that have one, connected through kept pixels.
fn fill(values: &mut [f32], left: &[Left], width: usize) {
    let mut queue: VecDeque<usize> = (0..values.len()).filter(|i| values[*i].is_finite()).collect();
    while let Some(i) = queue.pop_front() {
        let x = i % width;
        let around = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then_some(i + 1),
            i.checked_sub(width),
            (i + width < values.len()).then_some(i + width),
        ];
        for j in around.into_iter().flatten() {
            if left[j] == Left::Kept && values[j].is_nan() {
                values[j] = values[i];
                queue.push_back(j);
            }
        }
    }
}

/// Mean over the finite values in a square around each finite pixel.
fn local_mean(v: &[f32], width: usize, height: usize, radius: usize) -> Vec<f32> {
    (0..v.len())
        .into_par_iter()
        .map(|i| {
            if !v[i].is_finite() {
                return f32::NAN;
            }
            let (x, y) = (i % width, i / width);
            let (mut sum, mut n) = (0.0, 0);
            for yy in y.saturating_sub(radius)..(y + radius + 1).min(height) {
                for xx in x.saturating_sub(radius)..(x + radius + 1).min(width) {
                    let u = v[yy * width + xx];
                    if u.is_finite() {
                        sum += u;
                        n += 1;
                    }
                }
            }
            sum / n as f32
        })
        .collect()
}
