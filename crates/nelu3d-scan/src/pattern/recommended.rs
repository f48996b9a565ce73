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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::{Codewords, generate};

    /// As many images as asked for, and the more, the further are codes of far columns from each other.
    #[test]
    fn sets_have_their_number_of_images_and_tell_columns_apart() {
        for (length, axis) in [(640, Axis::X), (854, Axis::X), (1080, Axis::Y), (1920, Axis::X)] {
            let mut nearest = Vec::new();
            for n in RECOMMENDED_IMAGES {
                let (w, h) = if axis == Axis::X { (length, 1) } else { (1, length) };
                let set = generate(&recommended_patterns(length, axis, n).unwrap(), w, h).unwrap();
                assert_eq!(set.images.len(), n);
                let word = |u: usize| set.images.iter().map(move |p| p.image.data[u]);
                let words = Codewords::new(n, (0..length).flat_map(word).collect());
                let far = |u: usize, v: usize| -> f32 { word(u).zip(word(v)).map(|(a, b)| (a - b).powi(2)).sum() };
                let min = (0..length)
                    .flat_map(|u| (u + length / 100..length).map(move |v| (u, v)))
                    .map(|(u, v)| far(u, v))
                    .fold(f32::INFINITY, f32::min);
                assert!((0..length).all(|u| words.nearest(&word(u).collect::<Vec<_>>()).unwrap().0 == u));
                nearest.push(min.sqrt());
            }
            assert!(nearest[0] < nearest[1] && nearest[1] < nearest[2] && nearest[2] > 0.02, "{length}: {nearest:?}");
        }
    }

    #[test]
    fn other_numbers_and_tiny_images_are_refused() {
        assert!(recommended_patterns(1280, Axis::X, 4).unwrap_err().to_string().contains("3, 5 or 8"));
        assert!(recommended_patterns(60, Axis::X, 3).is_err());
        assert!(recommended_patterns(0, Axis::X, 3).is_err());
    }
}
