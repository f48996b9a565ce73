//! What the held-out positions tell: how far the field stays below its noise.

use crate::calibrate::shared_displacement::GrossSquares;
use crate::color_field::Quality;
use crate::verdict::{Code, Finding, Verdict};

/// How the held-out positions came out.
pub struct HeldOut<'a> {
    /// The measure.
    pub quality: &'a Quality,
    /// Why the field stays below its noise, if it does.
    pub shortfall: Option<&'a str>,
    /// Variance of the codewords that were compared, channel by channel, mean; NaN if nothing was.
    pub variance: f64,
    /// The position of which most is far off, by name, where positions were held out in turn.
    pub gross: Option<(&'a str, GrossSquares)>,
}

/// Fraction of the codewords' variance at unseen positions that a field has to predict, to be one.
const MIN_PREDICTED: f64 = 0.5;
/// Distance of unseen boards from the field beyond which 1σ does not make up for it, as a fraction of the depth that
/// the boards span.
const FAR_OFF: f64 = 0.01;
/// Fraction of a position's squares of pixels that may be gross errors.
const MANY_GROSS: f64 = 0.05;
/// Fraction of all positions' squares from which there is no field.
const MOSTLY_GROSS: f64 = 0.2;

/// Judges the quality at held-out positions; `span_mm` is the depth that the boards span along the camera's rays,
/// `wanted` names positions that the sweep lacks.
pub fn judge(held_out: &HeldOut<'_>, span_mm: f64, wanted: impl Fn() -> String) -> Vec<Finding> {
    let gross = held_out.gross.as_ref().filter(|(_, gross)| gross.of_position > MANY_GROSS).map(|(name, gross)| {
        let sentence = format!(
            "{:.0} % of board position {name} lies where the field of the other positions has something else, far \
             beyond what the rest of the boards is off by",
            100.0 * gross.of_position
        );
        let remedy = format!(
            "check that position, or leave it out; where it is right, add positions around it{}",
            and_at(&wanted())
        );
        let verdict = if gross.share > MOSTLY_GROSS { Verdict::Bad } else { Verdict::Doubtful };
        Finding::new(Code::PositionDisagrees, verdict, sentence, remedy)
            .with("position", *name)
            .with("share", gross.of_position)
    });
    below_noise(held_out, span_mm, gross.is_some(), wanted).into_iter().chain(gross).collect()
}

/// Judges how far a field stays below its noise. Where it was measured by how much boards that the field was not made
/// from are off in depth, 1σ contains that, and codewords that are predicted worse than noise allows are no fault: the
/// depths are what they are said to be.
fn below_noise(held_out: &HeldOut<'_>, span_mm: f64, has_gross: bool, wanted: impl Fn() -> String) -> Option<Finding> {
    let q = held_out.quality;
    let evidence = |f: Finding| {
        let predicted = 1.0 - 10f64.powf(-q.psnr_db / 10.0) / held_out.variance;
        f.with("psnr_db", q.psnr_db).with("ceiling_db", q.ceiling_db).with("predicted_share", predicted)
    };
    let sentence = held_out.shortfall?;
    let nothing = 10f64.powf(-q.psnr_db / 10.0) > (1.0 - MIN_PREDICTED) * held_out.variance;
    let near = q.depth_by_support.filter(|mm| !has_gross && mm[1] < FAR_OFF * span_mm);
    let finding = match (nothing, near) {
        (true, _) => Finding::new(
            Code::FieldBelowNoise,
            Verdict::Bad,
            sentence,
            "no field was found that predicts the sweep; check that light and camera stood still, and that the \
             patterns of every position are its own",
        ),
        (false, Some(mm)) => {
            let sentence = format!(
                "{sentence}; where another board was, boards that were held out are off by {:.2} mm, which 1σ contains",
                mm[1]
            );
            let remedy = format!("more positions make depth more certain{}", first_at(&wanted()));
            Finding::new(Code::FieldBelowNoise, Verdict::Good, sentence, remedy).with("depth_mm", mm[1])
        }
        (false, None) => Finding::new(
            Code::FieldBelowNoise,
            Verdict::Doubtful,
            sentence,
            match q.depth_by_support {
                // Positions were held out in turn: there are few.
                Some(_) => format!("add positions{}", first_at(&wanted())),
                None => "compare a scan of something that is known before others are trusted".into(),
            },
        ),
    };
    Some(evidence(finding))
}

/// Continues "add positions around it" by names of positions, if there are any.
fn and_at(wanted: &str) -> String {
    if wanted.is_empty() { String::new() } else { format!(", and {wanted}") }
}

/// Continues "more positions" by names of positions, if there are any.
fn first_at(wanted: &str) -> String {
    if wanted.is_empty() { String::new() } else { format!(", first {wanted}") }
}
