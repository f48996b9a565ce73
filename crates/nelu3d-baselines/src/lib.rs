//! The decoders that NeLU3D is compared with: they know the projector, and find in every pixel which of its columns lit it.
//!
//! ```text
//! patterns/ ─► code ─┐
//! captures ──────────┴► decode (one file a method) ─► columns, rows ─► triangulate ─► surface
//! ```
//!
//! The code is learned from the *projected images*: no file says what family they are of, and none needs to. Every image
//! must change along x or along y only. The projected values are taken to be linear in light; [`Options::gamma`] says
//! otherwise, and so does the response that [`projector::calibrate`] measures. A calibrated projector is required (`nelu3d projector` makes one).
//!
//! To add a method: a file with a function that fills a `Decoded`, a variant of [`Method`], an arm in [`run`].

mod captured;
mod code;
mod gray;
pub mod lookup3d;
mod mps;
mod phase;
pub mod projector;
mod triangulate;
pub mod turbosl;
mod wave;
mod zncc;

use std::path::PathBuf;

use nelu3d_scan::Rig;
use nelu3d_scan::pattern::Axis;
use nelu3d_scan::rig::{PatternSet, RigError, Shot};
use serde::{Deserialize, Serialize};

use nelu3d::progress::Progress;
use nelu3d::surface::{SurfaceMaps, assemble, drop_small, image_plane};
use nelu3d::progress::StageClock;
use nelu3d::surface::{PixelStatus, Reconstruction};
use captured::Captured;
use code::{Code, Light};
use triangulate::{Geometry, Range, Surface};

/// How the patterns are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Binary codes (Gray, binary, XOR), with or without inverses; edges between stripes found to sub-pixel.
    Gray,
    /// Phase shifting: three or more shifts of each frequency, unwrapped over the frequencies.
    Phase,
    /// Micro phase shifting (Gupta & Nayar 2012): three shifts of one frequency, one image of each other.
    Mps,
    /// Zero-mean normalized cross-correlation with the codewords of the columns: any patterns, three images or more.
    Zncc,
    /// TurboSL (Mirdehghan et al. 2024): a signed distance field, albedo, ambient light and blur by inverse rendering.
    #[cfg_attr(feature = "clap", value(name = "turbosl"))]
    #[serde(rename = "turbosl")]
    TurboSl,
    /// LookUp3D: the nearest codeword of the sweep's table; needs no projector.
    #[cfg_attr(feature = "clap", value(name = "lookup3d"))]
    #[serde(rename = "lookup3d")]
    Lookup3d,
    /// LookUp3D with the table as products of factors.
    #[cfg_attr(feature = "clap", value(name = "lookup3d-lowrank"))]
    #[serde(rename = "lookup3d-lowrank")]
    Lookup3dLowrank,
}

/// Which columns a codeword is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Columns {
    /// Those along the pixel's epipolar line, within the depth range.
    Epipolar,
    /// All.
    All,
}

impl Method {
    /// Whether it triangulates with a calibrated projector.
    pub fn needs_projector(self) -> bool {
        !matches!(self, Method::Lookup3d | Method::Lookup3dLowrank)
    }

    /// Its name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Method::Gray => "gray",
            Method::Phase => "phase",
            Method::Mps => "mps",
            Method::Zncc => "zncc",
            Method::TurboSl => "turbosl",
            Method::Lookup3d => "lookup3d",
            Method::Lookup3dLowrank => "lookup3d-lowrank",
        }
    }
}

/// Settings of a decoding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(deny_unknown_fields)]
pub struct Options {
    /// How the patterns are decoded
    #[cfg_attr(feature = "clap", arg(long, value_enum))]
    pub method: Method,
    /// Depth range in mm (default: that of RIG/fields/SET.safetensors if there is one, so that all methods have the same
    /// volume, else any depth for codes that need no range, and around where light and view cross for the others)
    #[cfg_attr(feature = "clap", arg(long, num_args = 2, value_names = ["NEAR", "FAR"]))]
    pub depth: Option<Vec<f64>>,
    /// Which columns a codeword is compared with (mps, zncc)
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Columns::Epipolar))]
    pub columns: Columns,
    /// Side of the window over which correlations are summed, px, odd (zncc; default: 1 with six images or more and with
    /// --columns all, else 9)
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX"))]
    pub patch: Option<usize>,
    /// Least correlation, -1 to 1 (zncc)
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.9))]
    pub min_score: f32,
    /// Blur of the projected images on the scene, standard deviation in projector px (zncc; default: estimated)
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX"))]
    pub blur: Option<f32>,
    /// Light that the projector makes of a value v of the projected images: v to this power (default: the response that
    /// `nelu3d projector` measured, if projector.json has one, else 1)
    #[cfg_attr(feature = "clap", arg(long, value_name = "POWER"))]
    pub gamma: Option<f64>,
    /// Least white − black of a pixel, as a share of full scale
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.02))]
    pub min_contrast: f32,
    /// Smallest connected piece of surface that is kept, px
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 40))]
    pub min_component: usize,
    /// Of LookUp3D.
    #[cfg_attr(feature = "clap", command(flatten))]
    #[serde(default)]
    pub lookup3d: lookup3d::Options,
    /// Of TurboSL.
    #[cfg_attr(feature = "clap", command(flatten))]
    #[serde(default)]
    pub turbosl: turbosl::Options,
}

impl Options {
    /// The default settings of a method.
    pub fn new(method: Method) -> Self {
        Self {
            method,
            depth: None,
            columns: Columns::Epipolar,
            patch: None,
            min_score: 0.9,
            blur: None,
            gamma: None,
            min_contrast: 0.02,
            min_component: 40,
            lookup3d: Default::default(),
            turbosl: Default::default(),
        }
    }
}

/// Why a scene was not decoded.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The rig folder or one of its images.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The lookup table.
    #[error(transparent)]
    Lookup3d(#[from] lookup3d::Error),
    /// A file that the decoder needs is missing or does not fit.
    #[error("{}: {problem}; {remedy}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// A setting that makes no sense.
    #[error("{setting} {problem}")]
    Setting {
        /// As it is typed.
        setting: &'static str,
        /// What is wrong, and what to do about it.
        problem: String,
    },
    /// The images of a set are no code of the method's kind.
    #[error("pattern set `{set}` cannot be decoded with --method {method}: {problem}; {remedy}")]
    Unsuited {
        /// The set.
        set: String,
        /// The method.
        method: &'static str,
        /// Why not.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// Nothing was decoded.
    #[error("{}: no pixel could be decoded: {reason}", path.display())]
    Nothing {
        /// The scene's folder.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The user stopped it.
    #[error("stopped before the scene was decoded; nothing was written")]
    Cancelled,
}

impl Error {
    fn file(path: impl Into<PathBuf>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::File { path: path.into(), problem: problem.into(), remedy: remedy.into() }
    }
}

/// Where along one axis of the projected image the pixels were lit from.
#[derive(Clone, Debug)]
struct Coordinate {
    axis: Axis,
    /// Projector px, one a pixel; NaN where it is unknown.
    at: Vec<f32>,
    /// Its standard deviation, projector px.
    sigma: Vec<f32>,
}

/// What a decoder found.
#[derive(Clone, Debug)]
struct Decoded {
    /// One coordinate, or both.
    coordinates: Vec<Coordinate>,
    /// Why pixels are left out, so far.
    status: Vec<PixelStatus>,
}

/// Decodes a scene of a rig.
///
/// # Errors
///
/// The rig has no calibrated projector or no projected images, an image cannot be read, the images are no code of the
/// method's kind, or nothing could be decoded. Every message says what to do.
pub fn run(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    opts: &Options,
    progress: &Progress,
) -> Result<Reconstruction, Error> {
    let mut clock = StageClock::new(progress);
    let stop = || if progress.cancelled() { Err(Error::Cancelled) } else { Ok(()) };
    check(opts)?;
    if !opts.method.needs_projector() {
        return lookup3d::run(rig, set, shot, opts, progress);
    }
    clock.begin("read the projected patterns");
    let projector = rig.projector.as_ref().ok_or_else(|| {
        Error::file(
            rig.root.join(nelu3d_scan::rig::PROJECTOR_FILE),
            "is missing, and decoding triangulates with a calibrated projector",
            "calibrate it with `nelu3d projector`, or reconstruct without one (`nelu3d calibrate`, `nelu3d reconstruct`)",
        )
    })?;
    let light = light(rig, opts)?;
    let code = Code::read(rig, set, projector, &light)?;

    clock.begin("read the scene");
    let images = captured::Images::read(rig, shot, set)?;
    stop()?;

    clock.begin("normalize");
    let captured = Captured::new(&images, rig, opts.min_contrast);
    let plane = image_plane(&rig.camera);
    let range = Range::new(rig, set, projector, opts)?;
    let geometry = Geometry::new(projector, &plane, range);

    clock.begin("decode");
    let mut info = serde_json::Map::new();
    let mut own_normals = Vec::new();
    let maps = if opts.method == Method::TurboSl {
        let (camera, patterns, settings) = (&rig.camera, &images.patterns, &opts.turbosl);
        let found =
            turbosl::decode(camera, projector, &plane, range.mm, patterns, &captured, &code, settings, progress)?;
        info.extend(found.info);
        own_normals = found.normals;
        found.maps
    } else {
        let decoded = match opts.method {
            Method::Gray => gray::decode(&captured, &code, set)?,
            Method::Phase => phase::decode(&captured, &code, set, &geometry)?,
            Method::Mps => mps::decode(&captured, &code, set, &geometry, opts.columns)?,
            Method::Zncc => zncc::decode(&captured, &code, set, &geometry, opts)?,
            Method::TurboSl | Method::Lookup3d | Method::Lookup3dLowrank => unreachable!("decoded elsewhere"),
        };
        stop()?;

        clock.begin("triangulate");
        let Surface { depth, sigma, left } = geometry.triangulate(&decoded);
        let residual = geometry.residual(&depth, &code, &captured);
        let ambient = vec![f32::NAN; depth.len()];
        SurfaceMaps { depth, sigma, left, residual, ambient }
    };
    let SurfaceMaps { mut depth, mut left, sigma, residual, ambient } = maps;
    drop_small(&mut depth, &mut left, &rig.camera, opts.min_component);
    if depth.iter().all(|z| z.is_nan()) {
        return Err(Error::Nothing { path: shot.dir.clone(), reason: why_nothing(&left) });
    }
    stop()?;

    clock.begin("build the surface");
    info.insert("settings".into(), serde_json::to_value(opts).expect("plain data serializes"));
    info.insert("depth_range".into(), serde_json::to_value(range).expect("plain data serializes"));
    info.insert("light".into(), serde_json::to_value(&light).expect("plain data serializes"));
    info.insert("images".into(), (set.images.len() + set.inverse.len() + 1 + usize::from(captured.has_black)).into());
    let maps = SurfaceMaps { depth, sigma, left, residual, ambient };
    let mut out = assemble(maps, &rig.camera, &plane, &images.white, info);
    for (normal, own) in out.normals.iter_mut().zip(own_normals) {
        if normal[0].is_finite() && own[0].is_finite() {
            *normal = own;
        }
    }
    out.stages = clock.finish();
    Ok(out)
}

/// What a projected value becomes: by the settings, by the projector's measured response, or as it is.
fn light(rig: &Rig, opts: &Options) -> Result<Light, Error> {
    Ok(match opts.gamma {
        Some(gamma) => Light::Power(gamma as f32),
        None => projector::read_response(&rig.root.join(nelu3d_scan::rig::PROJECTOR_FILE))?
            .map_or(Light::Power(1.0), Light::Response),
    })
}

fn check(opts: &Options) -> Result<(), Error> {
    if let Some(gamma) = opts.gamma.filter(|g| !(*g > 0.0 && g.is_finite())) {
        return Err(Error::Setting { setting: "--gamma", problem: format!("is {gamma}: give a positive number") });
    }
    if !(0.0..1.0).contains(&opts.min_contrast) {
        let problem = format!("is {}: give a number from 0 to below 1", opts.min_contrast);
        return Err(Error::Setting { setting: "--min-contrast", problem });
    }
    let longest = if opts.columns == Columns::All { 1 } else { 63 };
    if let Some(patch) = opts.patch.filter(|w| w.is_multiple_of(2) || *w > longest) {
        let problem = format!("is {patch}: give an odd number of pixels up to 63, and 1 with --columns all");
        return Err(Error::Setting { setting: "--patch", problem });
    }
    if !(-1.0..=1.0).contains(&opts.min_score) {
        return Err(Error::Setting { setting: "--min-score", problem: format!("is {}: give -1 to 1", opts.min_score) });
    }
    if opts.blur.is_some_and(|b| !(0.0..=100.0).contains(&b)) {
        return Err(Error::Setting { setting: "--blur", problem: "is no number of pixels from 0 to 100".into() });
    }
    Ok(())
}

fn why_nothing(status: &[PixelStatus]) -> String {
    let count = |l: PixelStatus| left.iter().filter(|v| **v == l).count() as f64 / left.len() as f64 * 100.0;
    format!(
        "{:.0} % of the pixels are too dark, {:.0} % clipped, {:.0} % outside the depth range, {:.0} % without a consistent \
         code; check the exposure, and that projector.json and patterns/ are those of this scene",
        count(PixelStatus::Underexposed),
        count(PixelStatus::Saturated),
        count(PixelStatus::OutsideVolume),
        count(PixelStatus::Ambiguous)
    )
}
