//! A scene of a rig, decoded with its table.

use std::path::Path;

use nelu3d::calibrate::{CalibrationOptions, Sweep};
use nelu3d::progress::{Progress, StageClock};
use nelu3d::result::SavedResult;
use nelu3d::sensor::{DarkEstimator, DarkLevel, Measurements, estimate_scene_noise, quantization_step};
use nelu3d::surface::{SurfaceMaps, assemble, image_plane, reject_small_components};
use nelu3d_scan::Rig;
use nelu3d_scan::rig::{Capture, Need, PatternSet, Shot};

use super::build::build;
use super::compress::{Rank, compress};
use super::decode::{MapBuffers, decode, decode_near};
use super::diagnostics::{LookupDiagnostics, TableSummary};
use super::error::LookupTableError;
use super::file::{self, Expected};
use super::table::Table;
use crate::coordinates::describe_no_depth;
use crate::diagnostics::{DecodeDiagnostics, Decoding, MethodDiagnostics};
use crate::error::DecodeError;
use crate::method::Method;
use crate::options::DecodeOptions;

/// Decodes a scene with a table from a file or from the rig's own sweep.
///
/// # Errors
/// The rig, the table or the earlier result cannot be used, or nothing was decoded.
pub(crate) fn decode_scene(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    opts: &DecodeOptions,
    progress: &Progress,
) -> Result<Decoding, DecodeError> {
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
            (file::read(path, Some(expected)).map_err(LookupTableError::from)?, None)
        }
        None => {
            let sweep = CalibrationOptions { min_contrast: opts.min_contrast, ..Default::default() };
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
    let step = quantization_step(rig.black_level, rig.saturation);
    let (noise, dark) = match sensor {
        Some(sensor) => sensor,
        None => (
            estimate_scene_noise(&capture.white, &capture.patterns, step),
            dark_of(&capture, rig, set, opts.min_contrast, progress)?,
        ),
    };
    let size = [capture.white.width, capture.white.height];
    let mut m = Measurements::as_measured(&capture, size, &noise, &dark);

    clock.begin("decode");
    let buffers = MapBuffers::of(&mut m);
    let found = match &previous {
        None => decode(&table, &m, &rig.camera, &own.settings, buffers),
        Some(depth) => decode_near(&table, &m, &rig.camera, &own.settings, buffers, depth),
    };
    stop()?;

    clock.begin("build the surface");
    let (mut depth, mut status) = (found.depth, found.status);
    reject_small_components(&mut depth, &mut status, &rig.camera, opts.min_component);
    if depth.iter().all(|z| z.is_nan()) {
        return Err(DecodeError::Nothing { path: shot.dir.clone(), reason: describe_no_depth(&status) });
    }
    let diagnostics = DecodeDiagnostics {
        settings: opts.clone(),
        images: set.images.len() + 1 + usize::from(capture.black.is_some()),
        method: MethodDiagnostics::Lookup(LookupDiagnostics {
            table: TableSummary::of(&table),
            fallbacks: found.n_fallbacks,
        }),
    };
    let ambient = vec![f32::NAN; depth.len()];
    let maps = SurfaceMaps { depth, sigma: found.sigma, status, residual: found.residual, ambient };
    let surface = assemble(maps, &rig.camera, &image_plane(&rig.camera), &capture.white);
    Ok(Decoding { surface, diagnostics, stages: clock.finish() })
}

/// Estimates what stands in for a black image that the scene lacks: the sweep's dark level, if there is a sweep.
fn dark_of(
    capture: &Capture,
    rig: &Rig,
    set: &PatternSet,
    min_contrast: f32,
    progress: &Progress,
) -> Result<Vec<DarkLevel>, LookupTableError> {
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

/// Reads the depth of an earlier result of the same camera.
fn depth_of(path: &Path, rig: &Rig) -> Result<Vec<f32>, LookupTableError> {
    let saved = SavedResult::read(path)?;
    let size = |w: usize, h: usize| format!("{w} × {h}");
    let (found, wanted) = (size(saved.camera.width, saved.camera.height), size(rig.camera.width, rig.camera.height));
    if found != wanted {
        return Err(LookupTableError::PreviousSize { path: path.to_owned(), found, wanted });
    }
    Ok(saved.depth)
}
