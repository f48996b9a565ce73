//! The camera's response, measured before anything else.

use std::path::Path;

use anyhow::Result;
use nelu3d_capture::page::SlideFiles;
use nelu3d_capture::{CaptureSession, RigWriter};
use nelu3d_scan::pattern::Superposition;

use super::report::ResponseSummary;
use crate::commands::camera::response::{RESPONSE_FOLDER, from_superposition};
use crate::commands::patterns::write_superposition;
use crate::context::CommandContext;

/// The images whose light adds up, among a display's patterns.
pub(super) struct ResponseSlides {
    /// The place of the first.
    pub(super) first: usize,
    /// Names of their captures.
    pub(super) names: Vec<String>,
}

impl ResponseSlides {
    /// They come after the `first` patterns.
    pub(super) fn after(first: usize) -> Self {
        Self { first, names: (0..Superposition::IMAGES).map(|i| format!("superposition_{i:02}.png")).collect() }
    }
}

/// Adds the images to those that are shown; they are made in the folder `place`.
pub(super) fn slides(all: &mut SlideFiles, place: &Path, context: &CommandContext) -> Result<ResponseSlides> {
    let folder = place.join("superposition");
    write_superposition(&folder, all.size, context)?;
    let slides = ResponseSlides::after(all.patterns.len());
    all.patterns.extend(slides.names.iter().map(|name| folder.join(name)));
    Ok(slides)
}

/// Takes the images, unless the rig has them, and states in the rig what they tell. Images that tell nothing are not
/// kept.
pub(super) fn measure(
    session: &mut CaptureSession<'_>,
    writer: &mut RigWriter,
    slides: &ResponseSlides,
) -> Result<ResponseSummary> {
    let rig = writer.rig();
    let (folder, levels) = (rig.root.join(RESPONSE_FOLDER), [rig.black_level, rig.saturation]);
    let is_new = !folder.exists();
    if is_new {
        let images = session.take_patterns(slides.first..slides.first + slides.names.len())?;
        writer.write_aside(RESPONSE_FOLDER, &slides.names, &images)?;
    }
    let measured = from_superposition(&folder, levels);
    if is_new && measured.is_err() {
        std::fs::remove_dir_all(&folder)?;
    }
    let measured = measured?;
    let name = measured.response.name().to_owned();
    writer.set_response(measured.response)?;
    Ok(ResponseSummary { name, report: measured.report })
}
