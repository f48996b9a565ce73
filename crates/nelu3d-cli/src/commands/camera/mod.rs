//! `nelu3d camera`: the camera is calibrated from images of a board; its response from images whose light adds up.

mod folder;
pub(crate) mod response;
mod text;

use std::path::PathBuf;

use anyhow::{Result, anyhow, bail};
use nelu3d_scan::Rig;
use nelu3d_scan::board::{Board, Corner, Detector};
use nelu3d_scan::camera::write_camera;
use nelu3d_scan::image::read_any;
use nelu3d_scan::intrinsics::{
    GrayImage, Intrinsics, IntrinsicsError, IntrinsicsOptions, StageStep, View, calibrate_intrinsics, find_boards,
};
use nelu3d_scan::output::{ReservedPath, write_atomic};
use nelu3d_scan::rig::{RIG_FILE, read_board};

use crate::args::CameraArgs;
use crate::context::CommandContext;
use crate::paths::shown;
use folder::images;
use text::text;

/// The images, and what is on them.
struct Source {
    board: Board,
    /// The rig that the images are of; none: a folder of images.
    rig: Option<Rig>,
    /// Name and file of each image.
    images: Vec<(String, PathBuf)>,
    /// Where the camera belongs.
    output: PathBuf,
}

/// Runs the command.
pub(crate) fn run(args: CameraArgs, context: &CommandContext) -> Result<()> {
    if args.response.measure {
        return response::run(&args, context);
    }
    let source = Source::open(&args)?;
    let output = args.output.clone().unwrap_or_else(|| source.output.clone());
    for file in [Some(&output), args.corners.as_ref()].into_iter().flatten() {
        if file.exists() && !args.force {
            bail!("{}: exists; give --force to replace it, or another file with -o FILE", shown(file));
        }
    }
    for name in &args.leave_out {
        if source.images.iter().all(|(n, _)| n != name) {
            bail!("{}: there is no image `{name}`; --leave-out takes the names of images", shown(&args.source));
        }
    }
    // Before the work: it must not end at a file that cannot be written.
    let _reserved = ReservedPath::new(&output)?;
    let stage = args.step.map(|step_mm| StageStep { step_mm, sigma_mm: args.step_sigma });
    let options = IntrinsicsOptions { model: args.model.0, stage, keep_uncertain: args.keep_uncertain };

    let size = source.load(0).map(|image| [image.width, image.height])?;
    let detector = Detector::new(&source.board).map_err(|e| anyhow!("{}: {e}", shown(&args.source)))?;
    context.progress.stage("find the boards");
    let found = source.find(&detector, size, context)?;
    context.progress.stage("calibrate the camera");
    let first = source.calibrate(&found, size, &args.leave_out, &options)?;
    // Corners are localized better where the lens is known.
    context.progress.stage("find the boards again, with the camera");
    let found = source.find(&detector.with_camera(&first.camera), size, context)?;
    context.progress.stage("calibrate the camera again");
    let result = source.calibrate(&found, size, &args.leave_out, &options)?;
    context.stop_if_asked()?;

    for ((name, _), found) in source.images.iter().zip(&found) {
        if let Err(reason) = found {
            context.progress.warn(format!("{name} is not used: {reason}"));
        }
    }
    if let Some(file) = &args.corners {
        let json = source.corners(&found)?;
        write_atomic(file, |w| w.write_all(json.as_bytes()))?;
    }
    write_camera(&output, &result.camera)?;
    context.answer(&serde_json::json!({ "camera": shown(&output), "report": result.report }), || {
        format!("{}camera    {}", text(&result.report), shown(&output))
    })?;
    Ok(())
}

/// The corners of each image, or why there are none.
type Found = Vec<Result<Vec<Corner>, String>>;

impl Source {
    fn open(args: &CameraArgs) -> Result<Self> {
        let path = &args.source;
        let is_rig = path.join(RIG_FILE).is_file() || path.file_name().is_some_and(|n| n == RIG_FILE);
        if !is_rig {
            let Some(file) = &args.board else {
                bail!(
                    "{}: is no rig; give the board that its images show with --board FILE (`nelu3d board` prints such a \
                     file's lines)",
                    shown(path)
                );
            };
            let images = images(path)?;
            return Ok(Self { board: read_board(file)?, rig: None, images, output: "camera.json".into() });
        }
        let rig = Rig::open_uncalibrated(path)?;
        let board = match (&args.board, &rig.board) {
            (Some(file), _) => read_board(file)?,
            (None, Some(board)) => board.clone(),
            (None, None) => {
                bail!("{}: [board] is missing; `nelu3d board` prints its lines", shown(&rig.root.join(RIG_FILE)))
            }
        };
        let images = rig.positions()?.into_iter().map(|s| (s.name, s.dir.join(&rig.white))).collect();
        let output = rig.root.join(&rig.camera_file);
        Ok(Self { board, rig: Some(rig), images, output })
    }

    /// Reads an image.
    fn load(&self, i: usize) -> Result<GrayImage> {
        let path = &self.images[i].1;
        let image = match &self.rig {
            Some(rig) => rig.read_image(path)?,
            None => read_any(path)?,
        };
        Ok(GrayImage { width: image.width, height: image.height, data: image.to_gray().into_owned() })
    }

    /// Finds the board in every image; all must have this size.
    fn find(&self, detector: &Detector, size: [usize; 2], context: &CommandContext) -> Result<Found> {
        let load = |i: usize| -> Result<GrayImage> {
            let image = self.load(i)?;
            if [image.width, image.height] != size {
                bail!(
                    "{}: has {} x {} pixels, but the first image has {} x {}; give images of one camera and setting",
                    shown(&self.images[i].1),
                    image.width,
                    image.height,
                    size[0],
                    size[1]
                );
            }
            Ok(image)
        };
        let progress = &context.progress;
        let tick = |done| {
            progress.tick(done, self.images.len());
            !progress.cancelled()
        };
        find_boards(detector, self.images.len(), load, tick)?.ok_or_else(|| anyhow!("stopped"))
    }

    fn calibrate(
        &self,
        found: &Found,
        size: [usize; 2],
        left_out: &[String],
        options: &IntrinsicsOptions,
    ) -> Result<Intrinsics> {
        let all = self.images.iter().zip(found).enumerate().filter(|(_, ((name, _), _))| !left_out.contains(name));
        let mut views = Vec::new();
        let mut reasons = Vec::new();
        for (number, ((name, _), found)) in all {
            match found {
                Ok(corners) => views.push(View { name: name.clone(), number, corners: corners.clone() }),
                Err(reason) => reasons.push((name.clone(), reason.clone())),
            }
        }
        let total = views.len() + reasons.len();
        calibrate_intrinsics(&views, size, options).map_err(|e| match e {
            // It knows nothing of images without a board.
            IntrinsicsError::TooFewViews { usable, needed, reasons: own, .. } => {
                reasons.extend(own);
                IntrinsicsError::TooFewViews { usable, total, needed, reasons }.into()
            }
            other => anyhow::Error::from(other),
        })
    }

    /// Returns the corners of all images as JSON: `{"name": [[board x, board y, image x, image y], …]}`, mm and px.
    fn corners(&self, found: &Found) -> Result<String> {
        let of = |((name, _), found): (&(String, PathBuf), &Result<Vec<Corner>, String>)| {
            let corners = found.as_ref().map(Vec::as_slice).unwrap_or_default();
            let rows: Vec<[f64; 4]> =
                corners.iter().map(|c| [c.board_mm[0], c.board_mm[1], c.px[0], c.px[1]]).collect();
            (name.clone(), serde_json::json!(rows))
        };
        let all: serde_json::Map<String, serde_json::Value> = self.images.iter().zip(found).map(of).collect();
        Ok(serde_json::to_string(&all)? + "\n")
    }
}
