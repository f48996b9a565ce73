//! A scene of a rig, decoded with its table.

use std::path::{Path, PathBuf};

use nelu3d_scan::Rig;
use nelu3d_scan::rig::{Capture, Need, PatternSet, Shot};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::file::{self, Expected};
use super::{Error, Memory, Rank, Settings, Table, build, compress, decode, decode_near};
use nelu3d::calibrate;
use nelu3d::sensor::{DarkEstimator, DarkLevel};
use nelu3d::sensor::{NoiseEstimator, NoiseModel};
use nelu3d::calibrate::Sweep;
use crate::{Error as DecodeError, Method, why_nothing};
use nelu3d::progress::Progress;
use nelu3d::surface::{SurfaceMaps, assemble, reject_small_components, image_plane};
use nelu3d::sensor::Measurements;
use nelu3d::progress::StageClock;
use nelu3d::result::SavedResult;
use nelu3d::surface::Reconstruction;

/// What LookUp3D needs to know.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "LookUp3D"))]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Lookup table to decode with, .npy or .npz (default: built from the rig's sweep)
    #[cfg_attr(feature = "clap", arg(long, value_name = "FILE"))]
    pub table: Option<PathBuf>,
    /// Build the table for every Nth pixel and row only; pixels between them are interpolated [default: 1]
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", conflicts_with = "table"))]
    pub stride: Option<usize>,
    /// Terms per channel of a low-rank table that is made here (default: as few as lose no more than its own noise)
    #[cfg_attr(feature = "clap", arg(long, value_name = "R"))]
    pub rank: Option<usize>,
    /// Result folder of the frame before: look around its depth first
    #[cfg_attr(feature = "clap", arg(long, value_name = "RESULT"))]
    pub previous: Option<PathBuf>,
    /// How the table is searched.
    #[cfg_attr(feature = "clap", command(flatten))]
    pub settings: Settings,
}

/// Decodes a scene with a table from a file or from the rig's own sweep.
///
/// # Errors
/// The rig, the table or the earlier result cannot be used, or nothing was decoded.
pub fn run(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    opts: &crate::Options,
    progress: &Progress,
) -> Result<Reconstruction, DecodeError> {
    let own = &opts.lookup3d;
    let mut clock = StageClock::new(progress);
    let stop = || if progress.cancelled() { Err(DecodeError::Cancelled) } else { Ok(()) };
    clock.begin("read the scene");
    let capture = rig.read_shot(shot, set, Need::Scene)?;
    let previous = own.previous.as_ref().map(|path| depth_of(path, rig)).transpose()?;

    let (mut table, sensor) = match &own.table {
        Some(path) => {
            clock.begin("read the lookup table");
            let expected = Expected { width: rig.camera.width, height: rig.camera.height, k: rig.channels_of(set) };
            (file::read(path, Some(expected)).map_err(Error::from)?, None)
        }
        None => {
            let sweep = calibrate::CalibrationOptions { min_contrast: opts.min_contrast, ..Default::default() };
            let built = build(rig, set, own.stride.unwrap_or(1), &sweep, progress, &mut clock)?;
            (Table::Full(built.table), Some((built.noise, built.dark)))
        }
    };
    stop()?;
    if let (Method::Lookup3dLowrank, Table::Full(full)) = (opts.method, &table) {
        clock.begin("compress the lookup table");
        table = Table::LowRank(compress(full, own.rank.map_or(Rank::Auto, Rank::Fixed)).table);
    }
    stop()?;

    clock.begin("normalize");
    let (noise, dark) = match sensor {
        Some(sensor) => sensor,
        None => (noise_of(&capture, rig), dark_of(&capture, rig, set, opts.min_contrast, progress)?),
    };
    let mut m = Measurements::new(&capture, &noise, &dark, 0.0);

    clock.begin("decode");
    let memory = Memory::of(&mut m);
    let found = match &previous {
        None => decode(&table, &m, &rig.camera, &own.settings, memory),
        Some(depth) => decode_near(&table, &m, &rig.camera, &own.settings, memory, depth),
    };
    stop()?;

    clock.begin("build the surface");
    let (mut depth, mut left) = (found.depth, found.status);
    reject_small_components(&mut depth, &mut left, &rig.camera, opts.min_component);
    if depth.iter().all(|z| z.is_nan()) {
        return Err(DecodeError::Nothing { path: shot.dir.clone(), reason: why_nothing(&left) });
    }
    let shape = table.shape();
    let rank = match &table {
        Table::Full(_) => None,
        Table::LowRank(t) => Some(t.rank),
    };
    let mut info = serde_json::Map::new();
    info.insert("settings".into(), serde_json::to_value(opts).expect("plain data serializes"));
    info.insert("images".into(), (set.images.len() + 1 + usize::from(capture.black.is_some())).into());
    info.insert(
        "table".into(),
        json!({
            "width": shape.width, "height": shape.height, "stride": shape.step, "positions": shape.n_positions,
            "channels": shape.k, "rank": rank, "bytes": table.bytes(),
        }),
    );
    info.insert("fallbacks".into(), found.n_fallbacks.into());
    let ambient = vec![f32::NAN; depth.len()];
    let maps = SurfaceMaps { depth, sigma: found.sigma, left, residual: found.residual, ambient };
    let mut out = assemble(maps, &rig.camera, &image_plane(&rig.camera), &capture.white, info);
    out.stages = clock.finish();
    Ok(out)
}

/// The sensor's noise as the scene itself shows it: a table from a file does not tell.
fn noise_of(capture: &Capture, rig: &Rig) -> NoiseModel {
    let mut estimator = NoiseEstimator::default();
    [&capture.white].into_iter().chain(capture.patterns.iter().take(3)).for_each(|image| estimator.add(image));
    estimator.finish((1.0 / (rig.saturation - rig.black_level).max(1e-9)) as f32)
}

/// What stands in for a black image that the scene lacks: the sweep's dark level, if there is a sweep.
fn dark_of(
    capture: &Capture,
    rig: &Rig,
    set: &PatternSet,
    min_contrast: f32,
    progress: &Progress,
) -> Result<Vec<DarkLevel>, Error> {
    let shots = match rig.positions() {
        Ok(shots) if capture.black.is_none() => shots,
        _ => return Ok(Vec::new()),
    };
    let sweep = Sweep::new(rig, set, shots, min_contrast);
    let parts = sweep.map_white_black(progress, |_, white, black| {
        let mut dark = DarkEstimator::default();
        dark.add(white, black, min_contrast);
        dark
    })?;
    let mut all = DarkEstimator::default();
    parts.iter().for_each(|part| all.merge(part));
    Ok(all.finish())
}

/// The depth of an earlier result of the same camera.
fn depth_of(path: &Path, rig: &Rig) -> Result<Vec<f32>, Error> {
    let saved = SavedResult::read(path)?;
    let size = |w: usize, h: usize| format!("{w} × {h}");
    let (found, wanted) = (size(saved.camera.width, saved.camera.height), size(rig.camera.width, rig.camera.height));
    if found != wanted {
        return Err(Error::PreviousSize { path: path.to_owned(), found, wanted });
    }
    Ok(saved.depth)
}
