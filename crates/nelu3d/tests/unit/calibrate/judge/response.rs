use nelu3d::calibrate::judge::response::{InkSums, judge};
use nelu3d::verdict::Code;

/// Ink at eight positions that shows `shown(c)` where the field has c, with noise.
fn ink(shown: impl Fn(f32) -> f32) -> Vec<InkSums> {
    ink_and_paper(shown, |c| c)
}

/// Ink and paper at eight positions that show `shown(c)` and `paper(c)` where the field has c, with noise.
fn ink_and_paper(shown: impl Fn(f32) -> f32, paper: impl Fn(f32) -> f32) -> Vec<InkSums> {
    let position = |p: usize| {
        let mut s = InkSums::default();
        for i in 0..2000 {
            let c = (i % 101) as f32 / 100.0;
            let noise = 0.1 * (((i * 7919 + p * 104_729) % 1000) as f32 / 500.0 - 1.0);
            s.ink.add(shown(c) + noise, c, 100.0);
            s.paper.add(paper(c) + noise, c, 100.0);
        }
        s
    };
    (0..8).map(position).collect()
}

#[test]
fn a_curve_is_told_from_glare() {
    assert!(judge(&ink(|c| c), Some(1.0)).is_none());
    // Half of the light is from elsewhere.
    assert!(judge(&ink(|c| 0.5 * c + 0.2), None).is_none());
    // A field that is smoother than its code, which paper shows as well.
    let smooth = |c: f32| c + 0.3 * c * (1.0 - c) * (1.0 - c);
    assert!(judge(&ink(smooth), None).is_some() && judge(&ink_and_paper(smooth, smooth), None).is_none());
    // sRGB, ink of a twentieth of the paper's light: by paper's intensity, ink's.
    let srgb = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let shown = |light: f32| {
        move |c: f32| (srgb(light * (c + 0.02)) - srgb(light * 0.02)) / (srgb(light * 1.02) - srgb(light * 0.02))
    };
    let (paper, ink_shows) = (shown(0.5), shown(0.025));
    let of_paper = |v: f32| (0..1000).map(|i| i as f32 / 1000.0).find(|c| paper(*c) >= v).unwrap_or(1.0);
    let found = judge(&ink(|v| ink_shows(of_paper(v))), Some(2.0)).unwrap();
    assert!(found.code == Code::NonlinearResponse && found.sentence.contains("darker"), "{found}");
    // Black and white alone tell nothing.
    let mut binary = vec![InkSums::default(); 8];
    binary.iter_mut().for_each(|s| (0..500).for_each(|i| s.ink.add(0.8 * (i % 2) as f32, (i % 2) as f32, 100.0)));
    assert!(judge(&binary, None).is_none());
    assert!(judge(&[], None).is_none());
    // But noise does, where sensors have more of it.
    let found = judge(&binary, Some(0.5)).unwrap();
    assert!(found.code == Code::NonlinearResponse && found.sentence.contains("0.50 times"), "{found}");
}
