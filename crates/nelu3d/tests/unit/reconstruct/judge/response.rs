use nelu3d::reconstruct::judge::response::{BINS, ResponseCurve};
use nelu3d::verdict::Code;

fn scattered(f: impl Fn(f64) -> f64, scatter: f64) -> Option<Code> {
    let medians = std::array::from_fn(|i| Some(f((i as f64 + 0.5) / BINS as f64)));
    ResponseCurve { medians, scatter }.judge().map(|f| f.code)
}

fn code(f: impl Fn(f64) -> f64) -> Option<Code> {
    scattered(f, 0.02)
}

#[test]
fn factors_and_curves_are_told_apart() {
    assert_eq!(code(|x| x), None);
    // A little light from elsewhere.
    assert_eq!(code(|x| 0.03 + 0.96 * x), None);
    // A bin of few pixels that show something else.
    assert_eq!(code(|x| if x > 0.9 { 0.8 } else { x }), None);
    assert_eq!(code(|x| x / 1.2), Some(Code::ExposureJump));
    assert_eq!(code(|x| x.powf(1.0 / 2.2)), Some(Code::NonlinearResponse));
    let narrow = ResponseCurve { medians: std::array::from_fn(|i| (i < 4).then_some(0.5)), scatter: 0.02 };
    assert!(narrow.judge().is_none());
}

#[test]
fn a_surface_that_is_not_there_is_no_response() {
    // Wrong depths: the mean codeword everywhere, and whatever was measured around it.
    assert_eq!(scattered(|x| 0.4 + 0.2 * x, 0.25), Some(Code::ResidualAboveNoise));
}
