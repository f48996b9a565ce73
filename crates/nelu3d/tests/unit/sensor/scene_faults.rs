use nelu3d::sensor::{
    CodewordStatistics, Support, SurfaceEvidence, judge_capture, judge_clipping, judge_codewords, judge_explained,
};
use nelu3d::surface::PixelStatus;
use nelu3d::verdict::{Code, Verdict};
use nelu3d_scan::Image;
use nelu3d_scan::rig::Capture;

/// `n` codewords of two channels that use their whole range.
fn codewords(n: usize) -> Vec<f32> {
    (0..n).flat_map(|i| [(i % 101) as f32 / 100.0, (i * 37 % 101) as f32 / 100.0]).collect()
}

#[test]
fn light_that_no_pattern_modulates_is_told() {
    let images = ["a.png".to_string(), "b.png".into()];
    let good = CodewordStatistics::new(&codewords(2000), 2);
    assert!(judge_codewords(&good, Some(&good), &images).is_empty());
    assert!(judge_codewords(&good, None, &images).is_empty());
    let mut all = codewords(2000);
    all.extend(vec![1.0; 6000]);
    let found = judge_codewords(&CodewordStatistics::new(&all, 2), Some(&good), &images);
    assert_eq!(found.iter().map(|f| f.code).collect::<Vec<_>>(), [Code::AmbientNotInBlack]);
}

#[test]
fn a_pattern_without_light_is_named() {
    let images = ["a.png".to_string(), "b.png".into()];
    let good = CodewordStatistics::new(&codewords(2000), 2);
    for (level, what) in [(0.02, "no light"), (0.98, "as bright as white")] {
        let mut all = codewords(2000);
        all.iter_mut().skip(1).step_by(2).for_each(|v| *v = level);
        let scene = CodewordStatistics::new(&all, 2);
        let found = judge_codewords(&scene, Some(&good), &images);
        assert!(found.len() == 1 && found[0].code == Code::PatternWithoutLight, "{found:?}");
        assert!(found[0].sentence.contains("b.png") && found[0].sentence.contains(what), "{}", found[0]);
        assert_eq!(found[0].verdict, Verdict::Bad);
        // Where the field has none either, nothing is wrong.
        assert!(judge_codewords(&scene, Some(&scene), &images).is_empty());
    }
}

#[test]
fn a_scene_within_one_stripe_of_a_binary_code_is_doubtful() {
    let bits = |one_stripe: bool| -> Vec<f32> {
        let bit = |i: usize, j: usize| if (i >> j) & 1 == 0 && !(one_stripe && j == 4) { 0.02 } else { 0.98 };
        (0..2000).flat_map(|i| (0..5).map(move |j| bit(i, j))).collect()
    };
    let names = ["4.png", "3.png", "2.png", "1.png", "0.png"].map(String::from);
    let [field, scene] = [false, true].map(|one| CodewordStatistics::new(&bits(one), 5));
    let found = judge_codewords(&scene, Some(&field), &names);
    assert!(found.len() == 1 && found[0].code == Code::PatternWithoutLight, "{found:?}");
    assert_eq!(found[0].verdict, Verdict::Doubtful);
    assert!(found[0].sentence.contains("0.png") && found[0].sentence.contains("one stripe"), "{}", found[0]);
    assert!(judge_codewords(&field, Some(&field), &names).is_empty());
}

#[test]
fn little_that_is_explained_is_doubtful() {
    let ends = |cut_by_volume| Some(SurfaceEvidence { cut_by_volume, ..SurfaceEvidence::default() });
    let mut status = vec![PixelStatus::Ambiguous; 1000];
    status[..100].fill(PixelStatus::Valid);
    for surface in [None, ends(0.0), ends(1.0)] {
        let found = judge_explained(&status, surface).unwrap();
        assert_eq!((found.code, found.verdict), (Code::LittleExplained, Verdict::Doubtful));
    }
    // A room around the object may be out of reach, but not where the object itself is cut.
    status[..550].fill(PixelStatus::Valid);
    assert!(judge_explained(&status, None).is_some() && judge_explained(&status, ends(0.4)).is_none());
    status[..700].fill(PixelStatus::Valid);
    let found = judge_explained(&status, ends(0.6)).unwrap();
    assert!(found.sentence.contains("where the volume does"), "{found}");
    assert!(judge_explained(&status, None).is_none() && judge_explained(&status, ends(0.4)).is_none());
    status[..900].fill(PixelStatus::Valid);
    assert!(judge_explained(&status, ends(0.9)).is_none());
}

#[test]
fn little_that_is_explained_well_is_noted() {
    let verdict = |explained: usize, cut_by_volume, unsupported, chi2, elsewhere| {
        let mut status = vec![PixelStatus::Ambiguous; 1000];
        status[..explained].fill(PixelStatus::Valid);
        let support = Some(Support { unsupported, elsewhere });
        judge_explained(&status, Some(SurfaceEvidence { cut_by_volume, chi2, support })).map(|found| found.verdict)
    };
    assert_eq!(verdict(200, 0.0, 0.1, None, 0), Some(Verdict::Good));
    assert_eq!(verdict(200, 0.0, 0.1, Some(0.9), 0), Some(Verdict::Good));
    assert_eq!(verdict(200, 0.0, 0.4, Some(0.9), 0), Some(Verdict::Doubtful));
    assert_eq!(verdict(200, 0.9, 0.1, Some(0.9), 0), Some(Verdict::Doubtful));
    assert_eq!(verdict(40, 0.0, 0.1, Some(0.9), 0), Some(Verdict::Doubtful));
    assert_eq!(verdict(600, 0.0, 0.4, Some(0.9), 0), None);
    // What fits worse than noise lets it has been explained by mistake.
    assert_eq!(verdict(200, 0.0, 0.1, Some(1.5), 0), Some(Verdict::Doubtful));
    // A room that is explained where it is tells nothing against the object, if that is not cut.
    assert_eq!(verdict(200, 0.0, 0.4, Some(0.9), 700), Some(Verdict::Good));
    assert_eq!(verdict(200, 0.9, 0.4, Some(0.9), 700), Some(Verdict::Doubtful));
}

#[test]
fn a_capture_is_judged_without_a_field() {
    let image =
        |f: &dyn Fn(usize) -> f32| Image { width: 60, height: 20, channels: 1, data: (0..1200).map(f).collect() };
    let capture = |second: &dyn Fn(usize) -> f32| Capture {
        white: image(&|_| 0.6),
        black: Some(image(&|_| 0.1)),
        patterns: vec![image(&|i| 0.1 + 0.5 * (i % 60) as f32 / 60.0), image(second)],
        mono: vec![false; 2],
    };
    let (status, names) = (vec![PixelStatus::Valid; 1200], ["a.png".to_string(), "b.png".into()]);
    assert!(judge_capture(&capture(&|i| 0.1 + 0.5 * (i / 60) as f32 / 20.0), &status, &names).is_empty());
    let found = judge_capture(&capture(&|_| 0.1), &status, &names);
    assert!(found.len() == 1 && found[0].code == Code::PatternWithoutLight, "{found:?}");
    assert_eq!(found[0].verdict, Verdict::Doubtful);
    // A binary code, whose coarse pattern may have one stripe where the object stands.
    let mut binary = capture(&|_| 0.1);
    binary.patterns = (0..5).map(|bit| image(&|i| if (i >> bit) & 1 == 0 || bit == 4 { 0.1 } else { 0.6 })).collect();
    binary.mono = vec![false; 5];
    let found = judge_capture(&binary, &status, &["4.png", "3.png", "2.png", "1.png", "0.png"].map(String::from));
    assert!(found.len() == 1 && found[0].verdict == Verdict::Good, "{found:?}");
}

#[test]
fn highlights_are_no_fault() {
    let mut status = vec![PixelStatus::Valid; 1000];
    status[..100].fill(PixelStatus::Saturated);
    assert!(judge_clipping(&status).is_none());
    status[..400].fill(PixelStatus::Saturated);
    assert_eq!(judge_clipping(&status).unwrap().code, Code::Clipped);
    status[400..].fill(PixelStatus::Underexposed);
    assert!((judge_clipping(&status).unwrap().evidence["clipped_share"].as_f64().unwrap() - 1.0).abs() < 1e-9);
}
