use nelu3d::calibrate::judge::corners::judge;
use nelu3d::verdict::Code;
use nelu3d_scan::pose::{Explanation, SharedCause, SharedMisfit};

fn misfit(rms_px: f64, share: f64, f: f64, depth_mm: f64) -> SharedMisfit {
    let cause = SharedCause::Bend;
    let causes = vec![Explanation { cause, share, f, bic: 0.0, depth_mm, amount: 1.0 }];
    SharedMisfit { rms_px, rms_explained_px: rms_px, focal_sigma: 0.1, causes }
}

#[test]
fn a_cause_has_to_explain_much_for_sure_and_to_matter() {
    let code = |m: SharedMisfit| judge(Some(&m), 700.0).map(|f| f.code);
    assert_eq!(code(misfit(0.1, 0.6, 200.0, 0.5)), Some(Code::BoardBent));
    assert_eq!(code(misfit(0.1, 0.1, 200.0, 0.5)), None);
    assert_eq!(code(misfit(0.1, 0.6, 5.0, 0.5)), None);
    assert_eq!(code(misfit(0.1, 0.6, 200.0, 0.05)), None);
    assert_eq!(code(misfit(2.0, 0.1, 5.0, 0.05)), Some(Code::CornersMisfit));
    assert!(judge(None, 700.0).is_none());
}
