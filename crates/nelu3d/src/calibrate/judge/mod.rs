//! Whether to trust a calibration: what was measured on the way, held against what a good sweep would give.
//!
//! Each file looks at one kind of evidence and returns findings. Limits are multiples of measured noise wherever there
//! is one, and far from what good rigs show; "bad" is kept for sweeps that cannot hold a field at all.

#[doc(hidden)]
pub mod corners;
#[doc(hidden)]
pub mod field;
#[doc(hidden)]
pub mod positions;
#[doc(hidden)]
pub mod repeated;
#[doc(hidden)]
pub mod repeats;
#[doc(hidden)]
pub mod response;
#[doc(hidden)]
pub mod scale;
mod spread;
#[doc(hidden)]
pub mod wanted;

use nelu3d_scan::pose::Steps;
use rayon::prelude::*;

use super::board_poses::SweepFacts;
use super::drawn::Drawn;
use super::placed_sweep::PlacedSweep;
use crate::color_field::ColorField;
use crate::sensor::BlockDetector;
use crate::verdict::{Code, Finding, Judgment, Verdict};
pub(super) use field::HeldOut;
use positions::PositionSums;
pub(super) use repeated::Fingerprint;
use response::InkSums;
pub use spread::DepthSpan;

/// What the judgment of a calibration rests on, besides field and sweep.
pub(super) struct Evidence<'a> {
    /// What the white images and the corners told.
    pub(super) facts: &'a SweepFacts,
    /// Steps of the stage by the boards' poses, if they stand on a line.
    pub(super) steps: Option<&'a Steps>,
    /// Steps of the stage as they were stated, mm.
    pub(super) step_mm: Option<f64>,
    /// How the held-out positions came out.
    pub(super) held_out: HeldOut<'a>,
    /// Positions that are not used, because their codewords do not fit the others'.
    pub(super) without_consensus: &'a [String],
    /// Positions of which a part is not used, and that fraction of the image.
    pub(super) excluded: &'a [(String, f64)],
}

/// Judges a calibration by what was drawn from its positions.
pub(super) fn judge(field: &ColorField, placed: &PlacedSweep<'_>, evidence: &Evidence<'_>) -> Judgment {
    let mut judgment = Judgment::default();
    let span = DepthSpan::of(placed);
    judgment.extend(spread::judge(&span, field));
    judgment.extend(corners::judge(evidence.facts.misfit.as_ref(), span.middle_mm));
    judgment.extend(scale::judge(
        evidence.facts.misfit.as_ref(),
        evidence.steps,
        placed.n_positions(),
        evidence.step_mm,
    ));
    judgment.extend(field::judge(&evidence.held_out, span.along_rays_mm, || wanted::named(&wanted::wanted(placed))));
    judgment.extend(evidence.without_consensus.iter().map(|name| {
        let sentence =
            format!("board position {name} is not used, because its codewords do not fit those of the others");
        let remedy =
            "its pose is wrong, the light or the camera had moved, or something stood in the light; take it again";
        Finding::new(Code::PositionDisagrees, Verdict::Doubtful, sentence, remedy).with("position", name.as_str())
    }));
    judgment.extend(parts_left_out(evidence.excluded));
    let names: Vec<&str> = placed.sweep.shots.iter().map(|s| s.name.as_str()).collect();
    judgment.extend(repeated::judge(placed.drawn().map(|(p, drawn)| (names[p], &drawn.fingerprint))));
    let (of_positions, of_ink): (Vec<_>, Vec<_>) = compare(field, placed).into_iter().unzip();
    judgment.extend(positions::judge(of_positions, &names, &field.metadata.images));
    judgment.extend(response::judge(&of_ink, placed.noise_growth));
    judgment.extend(repeats::judge(field, placed.sweep.sensor()));
    judgment.extend(captures(evidence.facts));
    judgment
}

/// Compares the samples that were drawn from positions with the field.
fn compare(field: &ColorField, placed: &PlacedSweep<'_>) -> Vec<(PositionSums, InkSums)> {
    let grid = field.to_grid();
    let of = |(p, drawn): (usize, &Drawn)| {
        (PositionSums::of(field, &grid, placed, p, drawn), InkSums::of(field, &grid, placed, p, drawn))
    };
    placed.drawn().collect::<Vec<_>>().into_par_iter().map(of).collect()
}

/// Notes the positions of which much is not used.
pub fn parts_left_out(excluded: &[(String, f64)]) -> impl Iterator<Item = Finding> {
    /// Fraction of a position's image that is worth a note if it is not used.
    const MUCH: f64 = 0.1;
    excluded.iter().filter(|(_, share)| *share > MUCH).map(|(name, share)| {
        let sentence =
            format!("{:.0} % of board position {name} is not used, because it does not fit the others", 100.0 * share);
        let remedy =
            "something stood before the board or in the light, or the board was bent; the others make up for it";
        Finding::new(Code::PositionPartLeftOut, Verdict::Good, sentence, remedy)
            .with("position", name.as_str())
            .with("share", *share)
    })
}

/// What the white images themselves tell.
fn captures(facts: &SweepFacts) -> impl Iterator<Item = Finding> {
    clipped(facts.clipped).into_iter().chain(compressed(&facts.blocks))
}

/// Judges how much of the lit part of the sweep is clipped.
pub fn clipped(share: f64) -> Option<Finding> {
    /// Fraction of the lit pixels, most of which are paper, that good exposures stay far below.
    const MAX_CLIPPED: f64 = 0.2;
    (share > MAX_CLIPPED).then(|| {
        let sentence = format!("{:.0} % of what is lit in the sweep's white images is clipped", 100.0 * share);
        Finding::new(Code::Clipped, Verdict::Doubtful, sentence, "expose for less, and check `saturation` in rig.toml")
            .with("clipped_share", share)
    })
}

/// Judges traces of lossy compression.
pub fn compressed(blocks: &BlockDetector) -> Option<Finding> {
    /// Excess of steps between blocks of 8 pixels over those within.
    const MAX_EXCESS: f64 = 1.25;
    let excess = blocks.excess();
    (excess > MAX_EXCESS).then(|| {
        let sentence = format!(
            "the white images have steps every 8 pixels, {:.0} % larger than those between, as JPEG leaves them",
            100.0 * (excess - 1.0)
        );
        let remedy = "take raw or losslessly compressed images: what compression removed does not come back";
        Finding::new(Code::LossyCompression, Verdict::Doubtful, sentence, remedy).with("block_step_excess", excess)
    })
}
