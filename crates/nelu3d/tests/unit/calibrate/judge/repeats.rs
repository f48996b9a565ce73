use nelu3d::calibrate::judge::repeats::{DEPTHS, double};

#[test]
fn a_double_lies_beyond_something_different() {
    let all = [true; DEPTHS];
    let wave = |period: f64| move |n: usize| (std::f64::consts::TAU * n as f64 / period).sin();
    let difference = |f: Box<dyn Fn(usize) -> f64>| move |a: usize, b: usize| 100.0 * (f(a) - f(b)).powi(2);
    assert!(double(&all, difference(Box::new(wave(30.0)))).is_some());
    assert!(double(&all, difference(Box::new(|n| n as f64 / 20.0))).is_none());
    // Nothing changes at all: no depth, but no double either.
    assert!(double(&all, difference(Box::new(|_| 0.5))).is_none());
    // The double is not lit.
    let half: [bool; DEPTHS] = std::array::from_fn(|n| n < 12);
    assert!(double(&half, difference(Box::new(wave(30.0)))).is_none());
}
