//! From the captures of a scene to a surface, by any of the methods.

use nelu3d::progress::{Progress, StageClock};
use nelu3d::surface::{SurfaceMaps, assemble, image_plane, reject_small_components};
use nelu3d_scan::Rig;
use nelu3d_scan::rig::{PatternSet, Shot};

use super::captured::{Captured, Images};
use super::code::{Code, ProjectedLight};
use super::coordinates::{DecodedCoordinates, describe_no_depth};
use super::diagnostics::{DecodeDiagnostics, Decoding, MethodDiagnostics};
use super::error::DecodeError;
use super::method::Method;
use super::options::DecodeOptions;
use super::projector::read_response;
use super::triangulate::{DepthRange, Geometry};
use super::{gray, lookup3d, mps, phase, turbosl, zncc};

/// Decodes a scene of a rig.
///
/// # Errors
///
/// The rig has no calibrated projector or no projected images, an image cannot be read, the images are no code of the
/// method's kind, or nothing could be decoded. Every message says what to do.
pub fn decode(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    opts: &DecodeOptions,
    progress: &Progress,
) -> Result<Decoding, DecodeError> {
    opts.check()?;
    if opts.method.needs_projector() {
        decode_with_projector(rig, set, shot, opts, progress)
    } else {
        lookup3d::decode_scene(rig, set, shot, opts, progress)
    }
}

/// Decodes a scene by triangulation.
fn decode_with_projector(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    opts: &DecodeOptions,
    progress: &Progress,
) -> Result<Decoding, DecodeError> {
    let mut clock = StageClock::new(progress);
    let stop = || if progress.cancelled() { Err(DecodeError::Cancelled) } else { Ok(()) };
    clock.begin("read the projected patterns");
    let projector = rig.projector.as_ref().ok_or_else(|| {
        DecodeError::file(
            rig.root.join(nelu3d_scan::rig::PROJECTOR_FILE),
            "is missing, and decoding triangulates with a calibrated projector",
            "calibrate it with `nelu3d projector`, or reconstruct without one (`nelu3d calibrate`, `nelu3d reconstruct`)",
        )
    })?;
    let light = light(rig, opts)?;
    // TurboSL takes any image, the others lines.
    let code = (opts.method != Method::TurboSl).then(|| Code::read(rig, set, projector, &light)).transpose()?;

    clock.begin("read the scene");
    let images = Images::read(rig, shot, set)?;
    stop()?;

    clock.begin("normalize");
    let captured = Captured::new(&images, rig, opts.min_contrast);
    let plane = image_plane(&rig.camera);
    let range = DepthRange::new(rig, set, projector, opts)?;
    let geometry = Geometry::new(projector, &plane, range);

    clock.begin("decode");
    let (maps, own_normals, training) = if let Some(code) = &code {
        let decoded = columns(&captured, code, set, &geometry, opts)?;
        stop()?;
        clock.begin("triangulate");
        let maps = geometry.triangulate(&decoded);
        let residual = geometry.residual(&maps.depth, code, &captured);
        (SurfaceMaps { residual, ..maps }, Vec::new(), None)
    } else {
        let shown = turbosl::ProjectedPlanes::read(rig, set, projector, &light, &captured)?;
        let scene = turbosl::TurboSlScene::new(
            &rig.camera,
            projector,
            &plane,
            range.mm,
            &images.patterns,
            &captured,
            &shown,
            opts.turbosl.unit_mm,
        )?;
        let found = turbosl::decode(&scene, &captured, &opts.turbosl, progress)?;
        (found.maps, found.normals, Some(found.diagnostics))
    };
    let SurfaceMaps { mut depth, mut status, sigma, residual, ambient } = maps;
    reject_small_components(&mut depth, &mut status, &rig.camera, opts.min_component);
    if depth.iter().all(|z| z.is_nan()) {
        return Err(DecodeError::Nothing { path: shot.dir.clone(), reason: describe_no_depth(&status) });
    }
    stop()?;

    clock.begin("build the surface");
    let maps = SurfaceMaps { depth, sigma, status, residual, ambient };
    let mut surface = assemble(maps, &rig.camera, &plane, &images.white);
    surface.replace_normals(&own_normals);
    let diagnostics = DecodeDiagnostics {
        settings: opts.clone(),
        images: set.images.len() + set.inverse.len() + 1 + usize::from(captured.has_black),
        method: MethodDiagnostics::Triangulated { depth_range: range, light, training },
    };
    Ok(Decoding { surface, diagnostics, stages: clock.finish() })
}

/// The projector columns (and rows) that lit the pixels, by the method of the settings.
fn columns(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
    opts: &DecodeOptions,
) -> Result<DecodedCoordinates, DecodeError> {
    match opts.method {
        Method::Gray => gray::decode(captured, code, set),
        Method::Phase => phase::decode(captured, code, set, geometry),
        Method::Mps => mps::decode(captured, code, set, geometry, opts.columns),
        Method::Zncc => zncc::decode(captured, code, set, geometry, opts),
        Method::TurboSl | Method::Lookup3d | Method::Lookup3dLowrank => unreachable!("decoded elsewhere"),
    }
}

/// What a projected value becomes: by the settings, by the projector's measured response, or as it is.
fn light(rig: &Rig, opts: &DecodeOptions) -> Result<ProjectedLight, DecodeError> {
    Ok(match opts.gamma {
        Some(gamma) => ProjectedLight::Power(gamma as f32),
        None => read_response(&rig.root.join(nelu3d_scan::rig::PROJECTOR_FILE))?
            .map_or(ProjectedLight::Power(1.0), ProjectedLight::Response),
    })
}
