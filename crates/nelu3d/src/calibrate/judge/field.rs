//! What the held-out positions tell: how far the field stays below its noise.

use crate::calibrate::shared_displacement::GrossSquares;
use crate::color_field::Quality;
use crate::verdict::{Code, Finding, Verdict};

/// How the held-out positions came out.
pub(in crate::calibrate) struct HeldOut<'a> {
    /// The measure.
    pub(in crate::calibrate) quality: &'a Quality,
    /// Why the field stays below its noise, if it does.
    pub(in crate::calibrate) shortfall: Option<&'a str>,
    /// Variance of the codewords that were compared, channel by channel, mean; NaN if nothing was.
    pub(in crate::calibrate) variance: f64,
    /// The position of which most is far off, by name, where positions were held out in turn.
    pub(in crate::calibrate) gross: Option<(&'a str, GrossSquares)>,
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
pub(super) fn judge(held_out: &HeldOut<'_>, span_mm: f64, wanted: impl Fn() -> String) -> Vec<Finding> {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of a sweep over 100 mm of depth.
    fn said(
        psnr_db: f64,
        shortfall: Option<&str>,
        off_mm: Option<f64>,
        gross: Option<[f64; 2]>,
    ) -> Vec<(Code, Verdict)> {
        let quality = Quality {
            held_out: Vec::new(),
            n: 1000,
            psnr_db,
            psnr_all_db: psnr_db,
            ceiling_db: 38.0,
            depth_mm: 0.2,
            pose_mm: 0.0,
            pose_covariance: None,
            depth_by_support: off_mm.map(|mm| [2.0 * mm, mm, mm, mm]),
            gross: gross.map(|g| g[0]),
            depth_noise: None,
            pixels: None,
        };
        let gross = gross.map(|[share, of_position]| ("003", GrossSquares { share, position: 3, of_position }));
        let held_out = HeldOut { quality: &quality, shortfall, variance: 0.1, gross };
        judge(&held_out, 100.0, || "at about 740 mm".into()).iter().map(|f| (f.code, f.verdict)).collect()
    }

    #[test]
    fn only_a_field_that_predicts_nothing_is_bad() {
        assert_eq!(said(37.0, None, None, None), []);
        assert_eq!(said(20.0, Some("why"), None, None), [(Code::FieldBelowNoise, Verdict::Doubtful)]);
        // 10 dB is the codewords' own variance.
        assert_eq!(said(11.0, Some("why"), Some(0.1), None), [(Code::FieldBelowNoise, Verdict::Bad)]);
        assert_eq!(said(f64::NAN, Some("why"), None, None), [(Code::FieldBelowNoise, Verdict::Doubtful)]);
    }

    #[test]
    fn what_sigma_contains_is_no_fault() {
        assert_eq!(said(20.0, Some("why"), Some(0.4), None), [(Code::FieldBelowNoise, Verdict::Good)]);
        assert_eq!(said(20.0, Some("why"), Some(0.4), Some([0.01, 0.04])), [(Code::FieldBelowNoise, Verdict::Good)]);
        // A displacement of more than a hundredth of the sweep is no uncertainty any more.
        assert_eq!(said(20.0, Some("why"), Some(1.5), None), [(Code::FieldBelowNoise, Verdict::Doubtful)]);
    }

    #[test]
    fn a_position_that_is_far_off_in_part_is_named() {
        let disagrees = |verdict| (Code::PositionDisagrees, verdict);
        assert_eq!(said(37.0, None, Some(0.1), Some([0.02, 0.1])), [disagrees(Verdict::Doubtful)]);
        let both = [(Code::FieldBelowNoise, Verdict::Doubtful), disagrees(Verdict::Bad)];
        assert_eq!(said(20.0, Some("why"), Some(0.1), Some([0.3, 0.6])), both);
    }
}
