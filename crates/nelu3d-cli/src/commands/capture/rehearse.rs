//! A capture without hardware: the images of another rig, through a display and a camera that do what real ones do.

use std::collections::HashMap;
use std::path::Path;

use anyhow::Result;
use nelu3d_capture::simulated::{SimulatedFaults, SimulatedRoom};
use nelu3d_capture::{CaptureSession, RigWriter, ShotPlace, Slide};
use nelu3d_scan::image::{Raw, decode};
use nelu3d_scan::rig::{RIG_FILE, Rig, Shot};

use super::report::CaptureReport;
use super::response::{self, ResponseSlides};
use crate::args::CaptureArgs;
use crate::commands::camera::response::RESPONSE_FOLDER;
use crate::context::CommandContext;

/// Three frames late, unevenly; 1 % of the frames lost, 5 % stale, 2 % delivered twice. The images have their noise.
const FAULTS: SimulatedFaults = SimulatedFaults {
    latency_frames: 3.0,
    jitter_frames: 0.9,
    loss: 0.01,
    stale: 0.05,
    stale_depth: 5,
    duplicated: 0.02,
    read_noise: 0.0,
    shot_noise: 0.0,
    automatic_exposure: 0.0,
};

/// Takes all board positions of the rig `source`, then its scenes, or those that were named.
pub(super) fn run(args: &CaptureArgs, source: &Path, context: &CommandContext) -> Result<CaptureReport> {
    if args.response.is_some() && !args.measures_response() {
        anyhow::bail!("--rehearse takes the response from the rig that it shows; leave --response away, or measure it");
    }
    let source = Rig::open(source)?;
    let mut writer = if args.rig.join(RIG_FILE).exists() {
        RigWriter::open(&args.rig)?
    } else {
        RigWriter::create_like(&args.rig, &source)?
    };
    let mut shots: Vec<(ShotPlace, Shot)> = Vec::new();
    if args.scene.is_empty() {
        let positions = if source.root.join("calibration").exists() { source.positions()? } else { Vec::new() };
        shots.extend(positions.into_iter().map(|shot| (ShotPlace::Position(shot.name.clone()), shot)));
        shots.extend(source.scenes()?.into_iter().map(|shot| (ShotPlace::Scene(shot.name.clone()), shot)));
    }
    for name in &args.scene {
        shots.push((ShotPlace::Scene(name.clone()), source.scene(name)?));
    }
    let all = shots.len();
    shots.retain(|(place, _)| !writer.folder(place).exists());
    let mut report = CaptureReport {
        rig: args.rig.clone(),
        found: all - shots.len(),
        has_intrinsics: writer.has_intrinsics(),
        ..CaptureReport::default()
    };
    let n = writer.pattern_names().len();
    let superposed = args.measures_response().then(|| superposed(&source, n)).transpose()?;
    let first = match (&superposed, shots.first()) {
        (Some((_, images)), _) => images.clone(),
        (None, Some((_, first))) => images(&writer, first)?,
        (None, None) => return Ok(report),
    };
    context.progress.stage("capture");
    let room = SimulatedRoom::new(first, FAULTS, all as u64);
    let (mut display, mut camera) = room.devices();
    let mut session = CaptureSession::start(&mut display, &mut camera)?;
    if let Some((slides, _)) = &superposed {
        report.response = Some(response::measure(&mut session, &mut writer, slides)?);
    }
    for (i, (place, shot)) in shots.iter().enumerate() {
        context.progress.tick(i, shots.len());
        context.stop_if_asked()?;
        room.set_images(images(&writer, shot)?);
        let taken = session.take(writer.pattern_names().len())?;
        report.written.push(writer.write(place, &taken)?);
        report.frames += taken.counts;
    }
    (report.timing, report.noise) = (Some(session.timing()), Some(session.noise()));
    report.exposure = Some(session.exposure(writer.rig().black_level, writer.rig().saturation));
    Ok(report)
}

/// Reads what the source's folder for measuring its response shows; the slides come after `n` patterns.
fn superposed(source: &Rig, n: usize) -> Result<(ResponseSlides, HashMap<Slide, Raw>)> {
    let folder = source.root.join(RESPONSE_FOLDER);
    let slides = ResponseSlides::after(n);
    let read = |name: &str| decode(&folder.join(name), None);
    let mut images = HashMap::from([(Slide::White, read("white.png")?), (Slide::Black, read("black.png")?)]);
    for (i, name) in slides.names.iter().enumerate() {
        images.insert(Slide::Pattern(slides.first + i), read(name)?);
    }
    Ok((slides, images))
}

/// Reads what a folder shows under each slide. It must have a black image.
fn images(writer: &RigWriter, shot: &Shot) -> Result<HashMap<Slide, Raw>> {
    let rig = writer.rig();
    let read = |name: &str| decode(&shot.dir.join(name), None);
    let mut images = HashMap::from([(Slide::White, read(&rig.white)?), (Slide::Black, read(&rig.black)?)]);
    for (i, name) in writer.pattern_names().iter().enumerate() {
        images.insert(Slide::Pattern(i), read(name)?);
    }
    Ok(images)
}
