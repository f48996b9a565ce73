//! A capture that a person guides, on the page.

use anyhow::Result;
use nelu3d_capture::page::{PageCommand, PageServer};
use nelu3d_capture::{BoardView, Camera, CaptureError, CaptureSession, RigWriter, ShotPlace, SlideImages, SweepGuide};
use nelu3d_scan::image::Raw;

use super::report::CaptureReport;
use super::response::{self, ResponseSlides};
use super::trial::{Trial, TrialAnswer};
use crate::context::CommandContext;

/// A capture under way.
struct Desk<'a> {
    server: &'a PageServer,
    writer: &'a mut RigWriter,
    guide: SweepGuide,
    context: &'a CommandContext,
    report: CaptureReport,
    trial: Trial,
    /// What the last trial said.
    tried: Option<TrialAnswer>,
}

/// Takes positions and scenes as the page asks for them; or the `scenes` at once.
pub(super) fn run(
    server: &PageServer,
    camera: &mut dyn Camera,
    writer: &mut RigWriter,
    scenes: &[String],
    response: Option<&ResponseSlides>,
    context: &CommandContext,
) -> Result<CaptureReport> {
    let report = CaptureReport {
        rig: writer.rig().root.clone(),
        found: writer.positions(),
        has_intrinsics: writer.has_intrinsics(),
        ..CaptureReport::default()
    };
    let mut guide = SweepGuide::new(writer.rig(), writer.has_intrinsics())?;
    resume(&mut guide, writer)?;
    let mut desk = Desk { server, writer, guide, context, report, trial: Trial::default(), tried: None };
    let mut display = server.display();
    let mut session = loop {
        desk.status("start", "measuring how long a flash takes to be seen");
        match CaptureSession::start(&mut display, camera) {
            Ok(session) => break session,
            // With nobody at the page there is nobody to help.
            Err(e) if !scenes.is_empty() => return Err(e.into()),
            Err(e @ (CaptureError::Stopped | CaptureError::Write(_))) => return Err(e.into()),
            Err(e) => desk.complain(&e.to_string()),
        }
        if matches!(server.command(), Some(PageCommand::Stop)) {
            return Ok(desk.report);
        }
    };
    desk.describe(&session);
    for warning in server.screen_warnings() {
        context.progress.warn(&warning);
    }
    if let Some(slides) = response
        && !desk.measure_response(&mut session, slides, scenes.is_empty())?
    {
        return Ok(desk.report);
    }
    if scenes.is_empty() {
        desk.follow(&mut session)?;
    }
    for name in scenes {
        desk.take(&mut session, &ShotPlace::Scene(name.clone()))?;
    }
    desk.status("done", "the capture has ended; this page may be closed");
    Ok(desk.report)
}

/// Returns whether an error ends the capture.
fn stops(e: &anyhow::Error) -> bool {
    use CaptureError::{Device, OtherFrames, Stopped, Write};
    matches!(e.downcast_ref(), Some(Device { .. } | OtherFrames { .. } | Stopped | Write(_)))
}

/// Lets the guide know of the positions that an earlier capture took.
fn resume(guide: &mut SweepGuide, writer: &RigWriter) -> Result<()> {
    if !guide.has_board() || writer.positions() == 0 {
        return Ok(());
    }
    for shot in writer.rig().positions()? {
        let white = nelu3d_scan::image::decode(&shot.dir.join(&writer.rig().white), None)?;
        if let Ok(view) = guide.find(&white)? {
            guide.add(view);
        }
    }
    Ok(())
}

impl Desk<'_> {
    fn status(&self, stage: &'static str, message: &str) {
        self.server.set_status(|s| {
            s.stage = stage;
            message.clone_into(&mut s.message);
        });
    }

    fn complain(&self, problem: &str) {
        self.context.progress.warn(problem);
        self.server.set_status(|s| problem.clone_into(&mut s.problem));
    }

    /// Shows what was measured.
    fn describe(&mut self, session: &CaptureSession<'_>) {
        let (timing, rig) = (session.timing(), self.writer.rig());
        let exposure = session.exposure(rig.black_level, rig.saturation);
        (self.report.timing, self.report.noise) = (Some(timing), Some(session.noise()));
        self.report.exposure = Some(exposure);
        let text = format!(
            "a frame every {:.0} ms; changes are seen after {:.0} to {:.0} ms",
            1e3 * timing.frame_secs,
            1e3 * timing.latency_min_secs,
            1e3 * timing.latency_max_secs
        );
        let coverage = self.guide.coverage();
        self.server.set_status(|s| {
            s.problem.clear();
            s.timing = text;
            s.exposure = Some(exposure);
            s.exposure_text = exposure.to_string();
            s.coverage = coverage;
        });
    }

    /// Measures how the camera's codes follow light; returns whether to go on. Where somebody is at the page, what fails
    /// is said there and tried again at the press of a button.
    fn measure_response(
        &mut self,
        session: &mut CaptureSession<'_>,
        slides: &ResponseSlides,
        is_guided: bool,
    ) -> Result<bool> {
        loop {
            self.status("busy", "measuring how the camera's codes follow light: do not touch anything");
            let problem = match response::measure(session, self.writer, slides) {
                Ok(measured) => {
                    self.report.response = Some(measured);
                    return Ok(true);
                }
                Err(e) if !is_guided || stops(&e) => return Err(e),
                Err(e) => e.to_string(),
            };
            self.complain(&problem);
            self.status("sweep", "press Take to measure the response again");
            loop {
                self.context.stop_if_asked()?;
                let frame = session.glance()?;
                let _ = self.look(&frame.raw)?;
                match self.server.command() {
                    Some(PageCommand::Stop) => return Ok(false),
                    Some(PageCommand::Take) => break,
                    Some(PageCommand::Finish | PageCommand::Scene(_)) | None => {}
                }
            }
        }
    }

    /// Shows the live picture and does what the page asks for, until that is to end.
    fn follow(&mut self, session: &mut CaptureSession<'_>) -> Result<()> {
        let mut stage = if self.guide.has_board() { "sweep" } else { "scenes" };
        loop {
            self.context.stop_if_asked()?;
            self.try_field();
            let next = if stage == "sweep" { self.next_step() } else { "name a scene and take it".into() };
            self.status(stage, &next);
            let frame = session.glance()?;
            let _ = self.look(&frame.raw)?;
            match self.server.command() {
                Some(PageCommand::Take) if stage == "sweep" => {
                    let place = self.writer.next_position()?;
                    self.try_to_take(session, &place)?;
                }
                Some(PageCommand::Scene(name)) if stage == "scenes" => {
                    self.try_to_take(session, &ShotPlace::Scene(name))?;
                }
                Some(PageCommand::Finish) => stage = "scenes",
                Some(PageCommand::Stop) => return Ok(()),
                Some(PageCommand::Take | PageCommand::Scene(_)) | None => {}
            }
        }
    }

    /// Shows what `calibrate` would say of the positions so far, where it can be run.
    fn try_field(&mut self) {
        if !self.guide.has_board() || !self.writer.has_intrinsics() {
            return;
        }
        if let Some(answer) = self.trial.follow(&self.writer.rig().root, self.writer.positions()) {
            self.server.set_status(|s| s.field.clone_from(&answer.text));
            self.tried = Some(answer);
        }
    }

    /// Returns what to do next in the sweep, in words.
    fn next_step(&self) -> String {
        let positions = self.writer.positions();
        if self.tried.as_ref().is_some_and(|t| t.is_good && t.positions == positions) {
            return "a field of these positions is good between them: go on to the scenes, or take more positions where \
                    the object will be"
                .into();
        }
        self.guide.next_step()
    }

    /// Shows a picture and looks for the board in it.
    fn look(&mut self, raw: &Raw) -> Result<Option<BoardView>> {
        let rig = self.writer.rig();
        let image = rig.linear(raw, &rig.root.join("(live)"), rig.channels)?;
        self.server.set_live(&image);
        if !self.guide.has_board() {
            return Ok(None);
        }
        let found = self.guide.find(raw)?;
        let (corners, text) = match &found {
            Ok(view) => {
                let depth = view.depth_mm.map(|z| format!(", {z:.0} mm away")).unwrap_or_default();
                let tilt = view.tilt_deg.map(|a| format!(", tilted by {a:.0}°")).unwrap_or_default();
                (view.corners_px.clone(), format!("the board: {} corners{depth}{tilt}", view.corners_px.len()))
            }
            Err(reason) => (Vec::new(), reason.clone()),
        };
        self.server.set_status(|s| {
            s.corners_px = corners;
            s.board = text;
        });
        Ok(found.ok())
    }

    /// Takes a folder of images; what can be tried again is said on the page.
    fn try_to_take(&mut self, session: &mut CaptureSession<'_>, place: &ShotPlace) -> Result<()> {
        match self.take(session, place) {
            Ok(()) => Ok(()),
            Err(e) => match e.downcast_ref() {
                Some(CaptureError::Unsteady { .. } | CaptureError::Moved { .. } | CaptureError::Unfit { .. }) => {
                    self.complain(&e.to_string());
                    Ok(())
                }
                _ => Err(e),
            },
        }
    }

    fn take(&mut self, session: &mut CaptureSession<'_>, place: &ShotPlace) -> Result<()> {
        self.status("busy", "taking images: do not touch anything");
        let images: SlideImages = session.take(self.writer.pattern_names().len())?;
        self.report.frames += images.counts;
        let view = self.look(&images.white.raw)?;
        if matches!(place, ShotPlace::Position(_)) && view.is_none() {
            let path = self.writer.folder(place);
            let problem = "was not kept, for the board was not found in it".into();
            let remedy = "turn the board to the camera, all of it in the picture and in the light".into();
            return Err(CaptureError::Unfit { path, problem, remedy }.into());
        }
        self.report.written.push(self.writer.write(place, &images)?);
        match (place, view) {
            (ShotPlace::Position(_), Some(view)) => self.guide.add(view),
            (ShotPlace::Scene(name), _) => self.server.set_status(|s| s.scenes.push(name.clone())),
            _ => {}
        }
        self.describe(session);
        Ok(())
    }
}
