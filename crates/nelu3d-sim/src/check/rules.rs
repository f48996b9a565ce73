//! Rules that values of several sections obey. An error tells the key, its value and a remedy.

use std::collections::HashSet;

use crate::spec::SpecError;

/// Longest side of an image, px.
const MAX_SIDE_PX: usize = 32_768;

/// Requires `good`, or fails with the key, its value and the remedy.
pub(super) fn check(good: bool, key: impl Into<String>, value: impl ToString, remedy: &str) -> Result<(), SpecError> {
    if good {
        return Ok(());
    }
    Err(SpecError::Value { key: key.into(), value: value.to_string(), remedy: remedy.into() })
}

/// Requires finite lengths and angles, far from where `f64` arithmetic on it would overflow.
pub(super) fn finite(key: &str, values: &[f64]) -> Result<(), SpecError> {
    let good = values.iter().all(|v| v.abs() < 1e7);
    check(good, key, format!("{values:?}"), "give finite numbers below ten million")
}

/// Requires a number above 0.
pub(super) fn positive(key: &str, value: f64) -> Result<(), SpecError> {
    check(value > 0.0 && value < 1e9, key, value, "give a number above 0")
}

/// Requires a number from `low` to `high`.
pub(super) fn within(key: &str, value: f64, low: f64, high: f64) -> Result<(), SpecError> {
    check((low..=high).contains(&value), key, value, &format!("give {low} to {high}"))
}

/// Requires a name that can be a file name and is not in `taken`, where it is entered.
pub(super) fn name(key: &str, name: &str, taken: &mut HashSet<String>) -> Result<(), SpecError> {
    let plain = !name.is_empty()
        && !name.starts_with('.')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.'));
    check(plain, key, format!("\"{name}\""), "use letters, digits, `-` and `_`: it becomes a file name")?;
    check(taken.insert(name.to_owned()), key, format!("\"{name}\""), "it is used twice; give each its own")
}

/// The optics of a camera or projector, to be checked.
pub(super) struct Optics<'a> {
    /// Section of the spec.
    pub(super) key: &'a str,
    /// Width and height, px.
    pub(super) size: [usize; 2],
    /// Focal lengths and principal point `[fx, fy, cx, cy]`, px.
    pub(super) intrinsics: [f64; 4],
    /// Whether the distortion coefficients make a model.
    pub(super) distortion: bool,
}

/// Checks the size and the intrinsics of a camera or projector.
pub(super) fn optics(o: &Optics) -> Result<(), SpecError> {
    for (side, n) in ["width", "height"].iter().zip(o.size) {
        check((1..=MAX_SIDE_PX).contains(&n), format!("{}.{side}", o.key), n, "give 1 to 32768 px")?;
    }
    let [fx, fy, cx, cy] = o.intrinsics;
    positive(&format!("{}.fx", o.key), fx)?;
    positive(&format!("{}.fy", o.key), fy)?;
    finite(&format!("{}.cx, cy", o.key), &[cx, cy])?;
    let key = format!("{}.distortion", o.key);
    check(o.distortion, key, "no list OpenCV knows", "give 0, 4, 5, 8, 12 or 14 finite coefficients")
}

/// Checks where a light source stands and the point that its axis passes through.
pub(super) fn aim(key: &str, position: [f64; 3], target: [f64; 3]) -> Result<(), SpecError> {
    finite(&format!("{key}.position_mm"), &position)?;
    finite(&format!("{key}.target_mm"), &target)?;
    let [x, y, z] = [0, 1, 2].map(|i| target[i] - position[i]);
    // Straight up or down there is no level direction to align its rows with.
    let good = (x * x + z * z).sqrt() > 1e-3 * (x * x + y * y + z * z).sqrt() + 1e-9;
    let remedy = "it must differ from position_mm, and not only in y";
    check(good, format!("{key}.target_mm"), format!("{target:?}"), remedy)
}
