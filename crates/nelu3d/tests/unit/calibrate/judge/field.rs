use nelu3d::calibrate::judge::field::{HeldOut, judge};
use nelu3d::calibrate::shared_displacement::GrossSquares;
use nelu3d::color_field::Quality;
use nelu3d::verdict::{Code, Verdict};

/// What is said of a sweep over 100 mm of depth.
fn said(psnr_db: f64, shortfall: Option<&str>, off_mm: Option<f64>, gross: Option<[f64; 2]>) -> Vec<(Code, Verdict)> {
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
