//! The set that a newcomer should show.

use super::axis::Axis;
use super::error::PatternError;
use super::family::Pattern;
use super::random::Random;
use super::sinusoid::Sinusoid;
use super::triangle::Triangle;

/// Numbers of images for which a set is recommended.
pub const RECOMMENDED_IMAGES: [usize; 3] = [3, 5, 8];

/// Returns patterns for a light source of `length_px` pixels along `axis` that make `images` images: a fine sinusoid for
/// precision, and a triangle wave and smooth noise that tell its periods apart. With five images and more the sinusoid
/// is shifted three times, so that it is nowhere flat; with eight there is one of a middle period, too. The sets were
/// chosen by measurement: `docs/patterns.md`, "The recommended set".
///
/// # Errors
///
/// Another number of images than [`RECOMMENDED_IMAGES`], or a light source too small for the sinusoid.
pub fn recommended_patterns(length_px: usize, axis: Axis, images: usize) -> Result<Vec<Pattern>, PatternError> {
    let length = length_px as f64;
    let sinusoid = |periods: f64, steps| Pattern::Sinusoid(Sinusoid { axis, period_px: length / periods, steps });
    let triangle = || Pattern::Triangle(Triangle { axis, period_px: length / 3.0 });
    let noise =
        |seed| Pattern::Random(Random { axis, min_period_px: length / 16.0, max_period_px: length / 2.0, seed });
    let patterns = match images {
        3 => vec![sinusoid(40.0, 1), triangle(), noise(9)],
        5 => vec![sinusoid(40.0, 3), triangle(), noise(9)],
        8 => vec![sinusoid(160.0 / 3.0, 3), sinusoid(16.0, 3), triangle(), noise(9)],
        _ => {
            let (value, remedy) = (images as f64, "give 3, 5 or 8");
            return Err(PatternError::Setting { family: "recommended", key: "images", value, remedy });
        }
    };
    // A period of less than two pixels is refused by the families themselves.
    for pattern in &patterns {
        pattern.generate(length_px.min(2), 1)?;
    }
    Ok(patterns)
}
