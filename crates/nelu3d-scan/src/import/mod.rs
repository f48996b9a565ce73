//! Recordings become part of a rig: a folder of numbered frames, as high-speed and video cameras write them, is cut
//! into groups of consecutive images (pattern, white, pattern, white, …), and each group becomes the folder of a frame,
//! a scene or a board position.
//!
//! PNG and TIFF frames are linked, or copied where the disk has no links; DNG and CinemaDNG become 16-bit PNG with the
//! same codes. Nothing is developed, scaled or demosaiced: the rig's reader does that. Every frame is decoded on the
//! way, so what has been imported can be read. See `docs/capture-format.md`, "Importing recordings".

mod batch;
mod destination;
mod dng;
mod error;
mod facts;
mod frame;
mod frames;
mod levels;
mod order;
mod report;
mod request;
mod store;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicUsize;

pub use dng::decode as decode_dng_with_facts;
pub use error::ImportError;
pub use facts::Facts as SensorFacts;
pub use frame::{Format as FrameFormat, Frame, read as read_frame};
pub use levels::{Codes as SensorCodes, Levels as SensorLevels, of as sensor_levels};
pub use report::ImportReport;
pub use request::{ImportRequest, ImportTarget};
pub use store::write as write_codes;

use self::batch::{Batch, numbered};
use self::destination::{Destination, Plan};
use self::frame::Kind;
use self::levels::{Codes, Levels};
use self::order::Slots;
use crate::image::{ImageFileError, Raw};
use crate::output::{OutputDir, write_atomic};
use crate::rig::{RIG_FILE, Rig, is_name};

/// Name of the report in every folder that an import made. It tells such folders from somebody's own.
pub const IMPORT_FILE: &str = "import.json";

/// Imports a recording. `progress` hears how many of how many frames are done, and returns whether to go on.
///
/// Frames are read in parallel, one a thread in memory (with `mean`, one per image of a group).
///
/// # Errors
///
/// A frame, the rig or the intrinsics cannot be read; frames of another size than the intrinsics or of different kinds;
/// numbers are missing among them; the order names unknown images; the output exists; something that a new rig needs is
/// neither given nor in the files. Every message names the file and what to do. Nothing is left behind then.
///
/// # Panics
///
/// If `every` is 0.
pub fn run(
    request: &ImportRequest,
    progress: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Result<ImportReport, ImportError> {
    assert!(request.every > 0, "every so many groups, at least 1");
    let files = frames::list(&request.frames, request.first, request.last)?;
    let destination = Destination::of(request)?;
    let first = frame::read(&files[0], (destination.camera().width, destination.camera().height))?;
    let Plan { mut rig, slots } = destination.plan(request, &first)?;
    let new_rig = matches!(destination, Destination::New { .. });
    if !new_rig {
        check_against(&rig, &first)?;
    }
    frames::check_numbers(&files, slots.len())?;
    let groups: Vec<&[PathBuf]> = files.chunks_exact(slots.len()).step_by(request.every).collect();
    check_groups(request, &rig, &slots, &files, groups.len())?;
    let output = output_of(&rig, &request.target)?;
    if output.exists() && !request.force {
        let remedy = "give --force to replace it, if it was imported, or choose another name";
        return Err(ImportError::unfit(output, "exists", remedy));
    }

    let mut notes = Vec::new();
    let left_over = files.len() % slots.len();
    notes.extend(note_on_left_over(request, files.len(), slots.len(), left_over));
    let out = OutputDir::create(&output, IMPORT_FILE)?;
    let batch = Batch { rig: &rig, slots: &slots, groups: &groups, kind: Kind::of(&first), progress };
    let (codes, folders) = write_groups(&batch, request, out.path())?;

    let found = levels::of(&first.raw, &first.facts, codes);
    if new_rig {
        set_levels(&mut rig, request, &found, &mut notes)?;
    } else {
        compare(&rig, &first, &found, &mut notes);
    }
    // What `linearize` would refuse must not be in a rig.
    first.raw.check_kind(&first.path, rig.channels, rig.saturation)?;
    note_what_is_missing(request, &rig, &slots, new_rig, &mut notes);

    let name_of = |file: Option<&PathBuf>| file.map(|f| frames::file_name(f)).unwrap_or_default();
    let given = request.black_level.is_some() && request.saturation.is_some();
    let report = ImportReport {
        output: output.clone(),
        source: request.frames.clone(),
        range: [name_of(groups[0].first()), name_of(groups[groups.len() - 1].last())],
        frames: groups.len() * slots.len(),
        left_over,
        groups: groups.len(),
        folders: folders.len(),
        order: slots,
        new_rig,
        channels: rig.channels.name(),
        black_level: rig.black_level,
        saturation: rig.saturation,
        levels: (new_rig && !given).then_some(found.reason),
        notes,
    };
    let text = serde_json::to_vec_pretty(&report).map_err(io::Error::other)?;
    write_atomic(&out.path().join(IMPORT_FILE), |w| w.write_all(&text))?;
    if !progress(report.frames, report.frames) {
        return Err(ImportError::Stopped);
    }
    // The frames first: a rig whose frames are missing would be worse than frames whose rig is.
    out.commit()?;
    if new_rig {
        rig.save()?;
    }
    Ok(report)
}

/// Returns a note on the frames at the end of a recording that are no whole group, if there are any.
fn note_on_left_over(request: &ImportRequest, files: usize, group: usize, left_over: usize) -> Option<String> {
    (left_over > 0).then(|| {
        format!(
            "{}: the last {left_over} of {files} frames are no whole group of {group}, and were left out",
            request.frames.display()
        )
    })
}

/// Writes the groups into their folders below `out`, with their black image where one was given. Returns the codes that
/// occurred, and the folders.
fn write_groups(batch: &Batch<'_>, request: &ImportRequest, out: &Path) -> Result<(Codes, Vec<PathBuf>), ImportError> {
    let is_scene = matches!(request.target, ImportTarget::Scene(_));
    let (mut codes, folders) = if request.mean {
        let dir = if is_scene { out.to_path_buf() } else { numbered(out, 0) };
        (batch.average(&dir)?, vec![dir])
    } else if is_scene {
        (batch.group(0, out, &AtomicUsize::new(0))?, vec![out.to_path_buf()])
    } else {
        batch.all(out)?
    };
    if let Some(black) = &request.black {
        let (dark, dark_codes) = batch.black(black)?;
        codes = codes.and(dark_codes);
        for dir in &folders {
            store::write(&dark, &dir.join(&batch.rig.black))?;
        }
    }
    Ok((codes, folders))
}

/// Notes the images that the rig expects and the recording does not have, and a missing description of the board.
fn note_what_is_missing(request: &ImportRequest, rig: &Rig, slots: &Slots, new_rig: bool, notes: &mut Vec<String>) {
    let is_calibration = request.target == ImportTarget::Calibration;
    let mut names: Vec<&String> = slots.iter().flatten().collect();
    names.extend(request.black.is_some().then_some(&rig.black));
    notes.extend(order::missing(&names, rig, is_calibration));
    if (new_rig || is_calibration) && rig.board.is_none() && rig.poses.is_empty() {
        notes.push(format!(
            "{}: has no [board] yet: describe the board of the sweep there before calibrating",
            rig.root.join(RIG_FILE).display()
        ));
    }
}

/// Decodes the content of a raw DNG file of this (width, height); `path` is only for messages.
///
/// # Errors
///
/// The file is damaged, compressed, of another size, or no raw image.
pub fn decode_dng(path: &Path, bytes: Vec<u8>, size: (usize, usize)) -> Result<Raw, ImageFileError> {
    dng::decode(path, bytes, size).map(|(raw, _)| raw)
}

/// Sets the levels of a new rig: what was given, else what was found.
fn set_levels(
    rig: &mut Rig,
    request: &ImportRequest,
    found: &Levels,
    notes: &mut Vec<String>,
) -> Result<(), ImportError> {
    rig.black_level = request.black_level.unwrap_or(found.black);
    rig.saturation = request.saturation.unwrap_or(found.saturation);
    if !(rig.saturation > rig.black_level && rig.saturation.is_finite() && rig.black_level.is_finite()) {
        let problem = format!("a saturation of {} with a black level of {}", rig.saturation, rig.black_level);
        return Err(ImportError::unfit(
            &request.frames,
            format!("would get {problem}"),
            "give both with --black-level and --saturation, the latter above the former",
        ));
    }
    if request.saturation.is_none() && !found.certain {
        notes.push(format!(
            "saturation {} is {}; correct it in rig.toml, or import again with --saturation, if the sensor clips \
             elsewhere",
            found.saturation, found.reason
        ));
    }
    Ok(())
}

/// Compares what the files say about the sensor with an old rig. Differences become notes, for files are known to be
/// wrong about it.
fn compare(rig: &Rig, first: &Frame, found: &Levels, notes: &mut Vec<String>) {
    let file = rig.root.join(RIG_FILE);
    if let Some(channels) = first.facts.channels.filter(|c| *c != rig.channels) {
        notes.push(format!(
            "{}: says camera.channels = \"{}\", but the frames say \"{}\"",
            file.display(),
            rig.channels.name(),
            channels.name()
        ));
    }
    if found.certain && (found.saturation / rig.saturation - 1.0).abs() > 0.02 {
        notes.push(format!(
            "{}: says camera.saturation = {}, but the frames look like {} ({})",
            file.display(),
            rig.saturation,
            found.saturation,
            found.reason
        ));
    }
}

/// Checks that a frame fits the rig, and is of a mono or a color camera as the rig is.
fn check_against(rig: &Rig, first: &Frame) -> Result<(), ImportError> {
    first.raw.check_kind(&first.path, rig.channels, rig.saturation)?;
    match first.facts.channels {
        Some(c) if c.count() != rig.channels.count() => Err(ImportError::unfit(
            &first.path,
            format!("is \"{}\", but rig.toml says camera.channels = \"{}\"", c.name(), rig.channels.name()),
            "import it into the rig of its camera, or correct rig.toml",
        )),
        _ => Ok(()),
    }
}

/// Checks that the frames make the groups that the target asks for.
fn check_groups(
    request: &ImportRequest,
    rig: &Rig,
    slots: &Slots,
    files: &[PathBuf],
    groups: usize,
) -> Result<(), ImportError> {
    let unfit = |problem: String, remedy: &str| Err(ImportError::unfit(&request.frames, problem, remedy));
    if groups == 0 {
        return unfit(
            format!("has {} frames, but a group is {}", files.len(), slots.len()),
            "record more, or correct --order, --first and --last",
        );
    }
    let is_scene = matches!(request.target, ImportTarget::Scene(_));
    if is_scene && groups > 1 && !request.mean {
        return unfit(
            format!("holds {groups} groups of {} frames, but a scene is one", slots.len()),
            "average them with --mean if nothing moved, or choose one with --first and --last",
        );
    }
    if request.mean && matches!(request.target, ImportTarget::Sequence(_)) {
        return unfit("would become a sequence of one frame".into(), "use --mean with --scene or --calibration only");
    }
    if let (Some(black), true) = (&request.black, slots.iter().flatten().any(|n| *n == rig.black)) {
        let problem = "is for recordings without black, but --order has it";
        return Err(ImportError::unfit(black, problem, "leave --black away, or name those frames skip"));
    }
    Ok(())
}

fn output_of(rig: &Rig, target: &ImportTarget) -> Result<PathBuf, ImportError> {
    let (folder, name) = match target {
        ImportTarget::Calibration => return Ok(rig.root.join("calibration")),
        ImportTarget::Sequence(name) => ("sequences", name),
        ImportTarget::Scene(name) => ("scenes", name),
    };
    if !is_name(name) {
        let path = rig.root.join(folder);
        return Err(ImportError::unfit(
            path,
            format!("`{name}` is no name of a folder"),
            "use letters, digits, - and _",
        ));
    }
    Ok(rig.root.join(folder).join(name))
}
