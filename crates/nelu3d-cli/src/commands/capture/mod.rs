//! `nelu3d capture`: from a camera and a light source to a rig folder.

mod device;
mod guided;
mod rehearse;
mod report;
mod response;
mod trial;

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use nelu3d_capture::page::{PageServer, SlideFiles};
use nelu3d_capture::{Camera, CommandCamera, NewRig, RigWriter, WatchedFolder};
use nelu3d_scan::camera::read_camera;
use nelu3d_scan::image::{Channels, decode};
use nelu3d_scan::rig::RIG_FILE;

use self::device::Sensor;
use self::report::CaptureReport;
use super::patterns::write_recommended;
use crate::args::{CaptureArgs, NewRigArgs};
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command.
pub(crate) fn run(args: CaptureArgs, context: &CommandContext) -> Result<()> {
    let report = match &args.rehearse {
        Some(source) => rehearse::run(&args, source, context)?,
        None => with_page(&args, context)?,
    };
    context.answer(&report, || report.text())?;
    Ok(())
}

/// Captures with the page as display, and whatever was typed as camera.
fn with_page(args: &CaptureArgs, context: &CommandContext) -> Result<CaptureReport> {
    // Before a rig is made that nobody can fill.
    if let Some(command) = &args.camera_command {
        CommandCamera::check(command)?;
    }
    let (sensor, driven) = device::connect(args, context)?.unzip();
    let mut writer = rig(args, sensor, context)?;
    let mut slides = slides(&writer)?;
    let made = tempfile::tempdir().context("no place for temporary files")?;
    let measures = args.measures_response().then(|| response::slides(&mut slides, made.path(), context)).transpose()?;
    let stop = context.cancel();
    let server = PageServer::start(slides, args.port, stop.clone())?;
    context.tell(&format!("open {} in a browser", server.address()));
    let folder = tempfile::tempdir().context("no place for temporary files")?;
    let mut camera: Box<dyn Camera> = match (driven, &args.camera_command, &args.watch) {
        (Some(on_clock), _, _) => on_clock(server.clock()),
        (_, Some(command), _) => Box::new(CommandCamera::new(command, folder.path(), server.clock(), stop)?),
        (_, _, Some(folder)) => Box::new(WatchedFolder::new(folder, server.clock(), stop)?),
        _ => Box::new(server.camera()),
    };
    guided::run(&server, camera.as_mut(), &mut writer, &args.scene, measures.as_ref(), context)
}

/// Opens the rig, or makes it.
fn rig(args: &CaptureArgs, sensor: Option<Sensor>, context: &CommandContext) -> Result<RigWriter> {
    let new = &args.new;
    if args.rig.join(RIG_FILE).exists() {
        let writer = RigWriter::open(&args.rig)?;
        if let Some(patterns) = &new.patterns {
            writer.keep_patterns(patterns)?;
        }
        let given = [
            ("--board", new.board.is_some()),
            ("--camera", new.camera.is_some()),
            ("--size", new.size.is_some()),
            ("--response", args.response.is_some() && !args.measures_response()),
        ];
        if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
            bail!("{}: exists and says this itself; leave {option} away", shown(&args.rig.join(RIG_FILE)));
        }
        return Ok(writer);
    }
    let made = tempfile::tempdir().context("no place for temporary files")?;
    let patterns = match (&new.patterns, new.size) {
        (Some(folder), _) => folder.clone(),
        (None, Some(size)) => {
            let folder = made.path().join("patterns");
            write_recommended(&folder, size, new.images, context)?;
            folder
        }
        (None, None) => bail!(
            "{}: is no rig yet, and a new one needs patterns; give the projector's size with --size 1280x800, or \
             --patterns DIR",
            shown(&args.rig)
        ),
    };
    Ok(RigWriter::create(&args.rig, &new_rig(args, sensor, new, &patterns)?)?)
}

fn new_rig(args: &CaptureArgs, sensor: Option<Sensor>, new: &NewRigArgs, patterns: &Path) -> Result<NewRig> {
    let (root, webcam) = (&args.rig, args.webcam);
    // Until it is measured, what is likely.
    let stated = args.response.clone().filter(|_| !args.measures_response());
    Ok(NewRig {
        name: root.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        channels: new.channels.or(sensor.map(|s| s.0)).unwrap_or(if webcam { Channels::Rgb } else { Channels::Mono }),
        black_level: new.black_level,
        saturation: new.saturation.or(sensor.map(|s| s.1)).unwrap_or(255.0),
        response: stated.or_else(|| webcam.then(|| "srgb".to_owned())),
        intrinsics: new.camera.as_deref().map(read_camera).transpose()?,
        board: new.board.clone(),
        patterns: patterns.to_path_buf(),
    })
}

/// Returns the images to show, which must all have one size.
fn slides(writer: &RigWriter) -> Result<SlideFiles> {
    let rig = writer.rig();
    let file = |name: &String| rig.projected(name);
    let slides = SlideFiles {
        white: file(&rig.white),
        black: file(&rig.black),
        patterns: writer.pattern_names().iter().map(file).collect(),
        size: [0, 0],
    };
    let mut size = None;
    for path in slides.patterns.iter().chain([&slides.white, &slides.black]) {
        if !path.exists() {
            bail!("{}: is missing; give the folder of the patterns with --patterns DIR", shown(path));
        }
        let raw = decode(path, None)?;
        let found = [raw.width, raw.height];
        if *size.get_or_insert(found) != found {
            bail!("{}: has another size than the other patterns; write them again with `nelu3d patterns`", shown(path));
        }
    }
    Ok(SlideFiles { size: size.unwrap_or([1, 1]), ..slides })
}
