use nelu3d_scan::pattern::{Axis, Gray, Pattern, PatternError, Ramp, Rgb, Sinusoid};

#[test]
fn channels_are_the_parts() {
    let part = |period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 2 });
    let parts = [part(8.0), part(9.0), part(11.0)];
    let rgb = Pattern::Rgb(Rgb { parts: parts.clone().map(Box::new) }).generate(30, 4).unwrap().images;
    assert_eq!(rgb.len(), 2);
    for (c, part) in parts.iter().enumerate() {
        for (image, expected) in rgb.iter().zip(part.generate(30, 4).unwrap().images) {
            let channel: Vec<f32> = image.image.data.iter().skip(c).step_by(3).copied().collect();
            assert_eq!(channel, expected.image.data);
        }
    }
}

#[test]
fn parts_that_do_not_fit_are_refused() {
    let ramp = || Box::new(Pattern::Ramp(Ramp::default()));
    let gray = Box::new(Pattern::Gray(Gray::default()));
    let error = Pattern::Rgb(Rgb { parts: [ramp(), ramp(), gray] }).generate(16, 4).unwrap_err();
    assert_eq!(error, PatternError::Parts { counts: [1, 1, 4] });
    let nested = Box::new(Pattern::Rgb(Rgb { parts: [ramp(), ramp(), ramp()] }));
    assert!(Pattern::Rgb(Rgb { parts: [ramp(), ramp(), nested] }).generate(16, 4).is_err());
}
