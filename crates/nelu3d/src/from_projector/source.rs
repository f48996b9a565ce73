//! What blur and response of a projector are estimated from.

use nelu3d_scan::pose::Bend;
use nelu3d_scan::rig::{Capture, PatternSet};
use nelu3d_scan::{Image, Rig};

use super::inputs::{find_scenes, read_captures};
use super::response::{MIN_CODEWORDS, Response, exponent_matters};
use crate::calibrate::{BoardSample, BoardSamples, CalibrationError, board_samples};
use crate::color_field::BoardPlace;
use crate::progress::{Progress, StageClock};
use crate::reconstruct::Codeword;
use crate::sensor::{Blur, DarkLevel, NoiseModel};
use crate::verdict::{Code, Finding, Verdict};

/// What blur and response are estimated from.
pub(super) enum Source {
    /// Boards of a sweep: codewords at points that are known.
    Boards {
        /// What they show.
        codewords: Vec<Codeword>,
        /// Where each is from.
        at: Vec<OnBoard>,
        /// Number of board positions.
        positions: usize,
    },
    /// Scenes, whose points are found by decoding.
    Scenes(Vec<Capture>),
}

impl Source {
    /// Returns the note that the response rests on scenes, where it matters.
    pub(super) fn unsure(&self, patterns: &[Image], response: Response) -> Option<Finding> {
        let Source::Scenes(_) = self else { return None };
        exponent_matters(patterns).then(|| {
            let sentence = format!(
                "the projector's response v^{:.2} was found from scenes alone: of few patterns, another response with \
                 other depths may explain the same images",
                response.gamma
            );
            let remedy = "add a board sweep, three positions or more, on which points are known";
            Finding::new(Code::ResponseFromScenes, Verdict::Good, sentence, remedy)
                .with("exponent", f64::from((100.0 * response.gamma).round()) / 100.0)
                .with("channels", patterns.len())
        })
    }
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Source::Boards { positions, .. } => write!(f, "{positions} boards"),
            Source::Scenes(captures) if captures.len() == 1 => write!(f, "a scene"),
            Source::Scenes(captures) => write!(f, "{} scenes", captures.len()),
        }
    }
}

/// Where a codeword of a board is from.
pub(super) struct OnBoard {
    /// Position, by index.
    pub(super) position: usize,
    /// The square of pixels that it lies in, across and down.
    pub(super) block: [usize; 2],
}

/// What a rig tells of its projector and of its camera.
pub(super) struct Evidence {
    /// What blur and response are estimated from.
    pub(super) source: Source,
    /// Noise of the sensor.
    pub(super) noise: NoiseModel,
    /// Light that is there without the projector, channel by channel, where a sweep tells it.
    pub(super) dark: Vec<DarkLevel>,
    /// Blur of the camera, where a sweep tells it.
    pub(super) blur: Option<Blur>,
    /// Where the boards of a sweep stood.
    pub(super) boards: Vec<BoardPlace>,
    /// Bend of a sweep's board, where it was taken into account.
    pub(super) bend: Option<Bend>,
}

impl Evidence {
    /// Takes the boards of the rig's sweep, or else its scenes.
    ///
    /// # Errors
    ///
    /// There is neither a sweep nor a scene, an image of a scene cannot be read, or the caller stopped the work.
    pub(super) fn find(
        rig: &Rig,
        set: &PatternSet,
        progress: &Progress,
        clock: &mut StageClock<'_>,
    ) -> Result<Self, CalibrationError> {
        if let Some(boards) = boards(rig, set, progress, clock)? {
            return Ok(boards);
        }
        let scenes = find_scenes(rig, set)?;
        clock.begin("read the scenes");
        let (captures, noise) = read_captures(rig, set, &scenes)?;
        let source = Source::Scenes(captures);
        Ok(Self { source, noise, dark: Vec::new(), blur: None, boards: Vec::new(), bend: None })
    }
}

/// Returns what the boards of the rig's sweep tell; `None` without a sweep, or with a warning where it cannot be used.
fn boards(
    rig: &Rig,
    set: &PatternSet,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<Option<Evidence>, CalibrationError> {
    if rig.board.is_none() || rig.positions().is_err() {
        return Ok(None);
    }
    let unusable = match board_samples(rig, set, progress, clock) {
        Ok(BoardSamples { samples, positions, noise, dark, blur, boards, bend }) if samples.len() >= MIN_CODEWORDS => {
            let at = samples.iter().map(|s| OnBoard { position: s.position, block: s.block }).collect();
            let codeword = |s: BoardSample| Codeword { point: s.point, intensities: s.values, variance: s.variance };
            let codewords = samples.into_iter().map(codeword).collect();
            let source = Source::Boards { codewords, at, positions };
            return Ok(Some(Evidence { source, noise, dark, blur: Some(blur), boards, bend }));
        }
        Ok(BoardSamples { samples, .. }) => format!("only {} pixels of its boards are well lit", samples.len()),
        Err(CalibrationError::Cancelled) => return Err(CalibrationError::Cancelled),
        Err(error) => error.to_string(),
    };
    progress.warn(format!(
        "blur and response of the projector are estimated from scenes, not on the sweep's boards: {unusable}"
    ));
    Ok(None)
}
