//! What the held-out positions tell: how far the field stays below its noise.

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
}

/// Fraction of the codewords' variance at unseen positions that a field has to predict, to be one.
const MIN_PREDICTED: f64 = 0.5;

/// Judges the quality at held-out positions.
pub(super) fn judge(held_out: &HeldOut<'_>) -> Option<Finding> {
    let q = held_out.quality;
    let evidence = |f: Finding| {
        let predicted = 1.0 - 10f64.powf(-q.psnr_db / 10.0) / held_out.variance;
        f.with("psnr_db", q.psnr_db).with("ceiling_db", q.ceiling_db).with("predicted_share", predicted)
    };
    let sentence = held_out.shortfall?;
    let nothing = 10f64.powf(-q.psnr_db / 10.0) > (1.0 - MIN_PREDICTED) * held_out.variance;
    let (verdict, remedy) = match nothing {
        true => (
            Verdict::Bad,
            "no field was found that predicts the sweep; check that light and camera stood still, and that the \
             patterns of every position are its own",
        ),
        false => (Verdict::Doubtful, "compare a scan of something that is known before others are trusted"),
    };
    Some(evidence(Finding::new(Code::FieldBelowNoise, verdict, sentence, remedy)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(psnr_db: f64, shortfall: Option<&str>) -> Option<(Code, Verdict)> {
        let quality = Quality {
            held_out: Vec::new(),
            n: 1000,
            psnr_db,
            psnr_all_db: psnr_db,
            ceiling_db: 38.0,
            depth_mm: 0.2,
            pose_mm: 0.0,
            pose_covariance: None,
            pixels: None,
        };
        judge(&HeldOut { quality: &quality, shortfall, variance: 0.1 }).map(|f| (f.code, f.verdict))
    }

    #[test]
    fn only_a_field_that_predicts_nothing_is_bad() {
        assert_eq!(verdict(37.0, None), None);
        assert_eq!(verdict(20.0, Some("why")), Some((Code::FieldBelowNoise, Verdict::Doubtful)));
        // 10 dB is the codewords' own variance.
        assert_eq!(verdict(11.0, Some("why")), Some((Code::FieldBelowNoise, Verdict::Bad)));
        assert_eq!(verdict(f64::NAN, Some("why")), Some((Code::FieldBelowNoise, Verdict::Doubtful)));
    }
}
