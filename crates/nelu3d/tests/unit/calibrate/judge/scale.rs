use nelu3d::calibrate::judge::scale::judge;
use nelu3d::verdict::{Code, Verdict};
use nelu3d_scan::pose::{SharedMisfit, Steps};

#[test]
fn a_stage_tells_the_scale() {
    let steps = |mean_mm| Steps { direction: [0.0, 0.0, 1.0], mean_mm, deviation_mm: 0.02 };
    assert!(judge(None, Some(&steps(6.01)), 12, Some(6.0)).is_none());
    // A sweep toward the camera.
    assert!(judge(None, Some(&steps(-6.01)), 12, Some(6.0)).is_none());
    let found = judge(None, Some(&steps(6.6)), 12, Some(6.0)).unwrap();
    assert!(found.code == Code::ScaleContradicted && found.sentence.contains("10.0 % too large"), "{found}");
    // A stage that is not exact.
    let rough = Steps { deviation_mm: 2.0, ..steps(6.6) };
    assert!(judge(None, Some(&rough), 12, Some(6.0)).is_none());
    for (steps, stated) in [(None, Some(6.0)), (Some(&rough), None), (None, None)] {
        let note = judge(None, steps, 12, stated).unwrap();
        assert_eq!((note.code, note.verdict), (Code::ScaleNotChecked, Verdict::Good));
        assert_eq!(note.sentence.contains("no line"), stated.is_some());
    }
}

#[test]
fn tilted_boards_tell_the_focal_length() {
    let misfit = |focal_sigma| SharedMisfit { rms_px: 0.1, rms_explained_px: 0.1, focal_sigma, causes: Vec::new() };
    assert!(judge(Some(&misfit(0.1)), None, 12, None).unwrap().sentence.contains("focal length"));
    assert!(!judge(Some(&misfit(0.001)), None, 12, None).unwrap().sentence.contains("focal length"));
}
