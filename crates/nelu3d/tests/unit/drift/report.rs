use nelu3d::color_field::LightMotion;
use nelu3d::drift::{DriftReport, Moved};
use nelu3d::verdict::Verdict;

fn report(moved: Moved, rigid: bool) -> DriftReport {
    DriftReport {
        moved,
        shift_px: 1.04,
        direction_px: [-1.0, 0.2],
        motion: LightMotion::none([0.0; 3]),
        rigid,
        chi2_still: 9.0,
        chi2_moved: 0.7,
        corner_rms_px: 0.03,
        position: Some("011".into()),
        corners_px: Some([0.01, 0.02]),
    }
}

#[test]
fn it_says_who_moved_and_how_far() {
    assert_eq!(report(Moved::Nothing, true).finding().map(|f| f.sentence), None);
    let light = report(Moved::Light, true).finding().unwrap();
    assert!(light.sentence.contains("light source moved") && light.sentence.contains("1.0 px to the left"));
    assert!(light.verdict == Verdict::Doubtful && light.remedy.contains("--correct"));
    assert!(report(Moved::Unknown, true).finding().unwrap().sentence.contains("which of them"));
    assert!(!report(Moved::Camera, false).finding().unwrap().remedy.contains("--correct"));
}
