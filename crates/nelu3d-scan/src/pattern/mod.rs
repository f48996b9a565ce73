//! Projected patterns: what to show, as pure functions of a size. One file per family.
//!
//! Every family promises: images of the asked size, one channel ([`Rgb`] and [`Film`] three), values in `[0, 1]` linear in light, the
//! same images for the same settings. To add one, write its file, add it to [`Pattern`] and to the tests' list.

mod alacarte;
mod binary;
mod bits;
mod codewords;
mod film;
mod gray;
mod hilbert;
mod mps;
mod noise;
mod phase;
mod ramp;
mod random;
mod rgb;
mod score;
mod sinusoid;
mod triangle;
mod wave;
mod xor;

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

pub use alacarte::Alacarte;
pub use binary::{Binary, decode_binary};
pub use bits::BitCode;
pub use codewords::{Codewords, Stripes};
pub use film::Film;
pub use gray::{Gray, decode_gray};
pub use hilbert::{Hilbert, hilbert_codewords};
pub use mps::{Mps, MpsDecoder};
pub use phase::{Decoded, PhaseDecoder, PhaseShift};
pub use ramp::Ramp;
pub use random::Random;
pub use rgb::Rgb;
pub use score::{DecodingErrors, Score, ScoreOptions, Sensitivity, Separation, confusion_matrix, score};
pub use sinusoid::Sinusoid;
pub use triangle::Triangle;
pub use wave::{FittedWave, Wave};
pub use xor::{Xor, decode_xor};

use crate::image::Image;

/// Why a pattern cannot be made.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PatternError {
    /// The size of the light source's image.
    #[error("a pattern of {width} x {height} px cannot be made; give each side 1 to {MAX_SIDE_PX} px")]
    Size {
        /// Columns asked for.
        width: usize,
        /// Rows asked for.
        height: usize,
    },
    /// A setting out of its range.
    #[error("pattern {family}: `{key}` is {value}; {remedy}")]
    Setting {
        /// The family.
        family: &'static str,
        /// The setting.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        remedy: &'static str,
    },
    /// Three channels that do not fit together.
    #[error("pattern rgb: its three parts make {counts:?} images; let each make the same number, in one channel")]
    Parts {
        /// Images of each part.
        counts: [usize; 3],
    },
    /// Images that are no code of a family.
    #[error("these images are no code of the family {family}: {problem}")]
    Code {
        /// The family.
        family: &'static str,
        /// What is wrong.
        problem: &'static str,
    },
    /// Only some of a set's patterns have inverses.
    #[error("some patterns of the set have inverse images and some have none; give all of them inverses, or none")]
    PartialInverse,
}

/// The longest side a pattern may have, px.
const MAX_SIDE_PX: usize = 32_768;

/// The direction along which a pattern changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// From column to column.
    #[default]
    X,
    /// From row to row.
    Y,
}

impl Axis {
    /// Its letter, as in `gray_x_00.png`.
    pub fn letter(self) -> char {
        match self {
            Axis::X => 'x',
            Axis::Y => 'y',
        }
    }

    /// The side of a `width × height` image along this axis, px.
    fn length(self, width: usize, height: usize) -> usize {
        match self {
            Axis::X => width,
            Axis::Y => height,
        }
    }
}

/// A pattern family with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "family", rename_all = "lowercase")]
pub enum Pattern {
    /// A (phase-shifted) sinusoid.
    Sinusoid(Sinusoid),
    /// A triangle wave.
    Triangle(Triangle),
    /// One ramp from dark to bright.
    Ramp(Ramp),
    /// Smooth noise of a limited band.
    Random(Random),
    /// Gray code, one bit an image.
    Gray(Gray),
    /// Binary code, one bit an image.
    Binary(Binary),
    /// Gray code without wide stripes.
    Xor(Xor),
    /// Phase shifting of one or several periods.
    Phase(PhaseShift),
    /// Micro phase shifting.
    Mps(Mps),
    /// Points of a Hilbert curve.
    Hilbert(Hilbert),
    /// Optimized for decoding by ZNCC.
    Alacarte(Alacarte),
    /// Three patterns as the channels of one.
    Rgb(Rgb),
    /// A strip of color film.
    Film(Film),
}

/// One image to project.
#[derive(Clone, Debug, PartialEq)]
pub struct PatternImage {
    /// Its name without extension, as `sine_00`.
    pub name: String,
    /// `height × width`, values in `[0, 1]`.
    pub image: Image,
}

/// The images of a pattern set, as a rig's pattern set lists them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PatternImages {
    /// The patterns.
    pub images: Vec<PatternImage>,
    /// Their inverses; empty, or one per image.
    pub inverse: Vec<PatternImage>,
}

impl Pattern {
    /// The images of this family alone.
    ///
    /// # Errors
    ///
    /// As [`generate`].
    pub fn generate(&self, width: usize, height: usize) -> Result<PatternImages, PatternError> {
        generate(std::slice::from_ref(self), width, height)
    }

    /// Whether its images have three channels, which only a color camera can tell apart.
    pub fn is_color(&self) -> bool {
        matches!(self, Pattern::Rgb(_) | Pattern::Film(_))
    }

    /// The same pattern with every setting that was left to the size of the image written out.
    ///
    /// # Errors
    ///
    /// A setting out of its range.
    pub fn resolved(&self, width: usize, height: usize) -> Result<Self, PatternError> {
        Ok(match self {
            Pattern::Phase(p) => Pattern::Phase(p.resolved(p.axis.length(width, height))?),
            Pattern::Mps(p) => Pattern::Mps(p.resolved(p.axis.length(width, height))?),
            Pattern::Rgb(p) => {
                let mut parts = p.parts.clone();
                for part in &mut parts {
                    **part = part.resolved(width, height)?;
                }
                Pattern::Rgb(Rgb { parts })
            }
            Pattern::Sinusoid(_)
            | Pattern::Triangle(_)
            | Pattern::Ramp(_)
            | Pattern::Random(_)
            | Pattern::Gray(_)
            | Pattern::Binary(_)
            | Pattern::Xor(_)
            | Pattern::Hilbert(_)
            | Pattern::Alacarte(_)
            | Pattern::Film(_) => self.clone(),
        })
    }

    /// The same pattern along another axis.
    #[must_use]
    pub fn along(&self, axis: Axis) -> Self {
        let mut pattern = self.clone();
        match &mut pattern {
            Pattern::Sinusoid(p) => p.axis = axis,
            Pattern::Triangle(p) => p.axis = axis,
            Pattern::Ramp(p) => p.axis = axis,
            Pattern::Random(p) => p.axis = axis,
            Pattern::Gray(p) => p.axis = axis,
            Pattern::Binary(p) => p.axis = axis,
            Pattern::Xor(p) => p.axis = axis,
            Pattern::Phase(p) => p.axis = axis,
            Pattern::Mps(p) => p.axis = axis,
            Pattern::Hilbert(p) => p.axis = axis,
            Pattern::Alacarte(p) => p.axis = axis,
            Pattern::Rgb(p) => p.parts.iter_mut().for_each(|part| **part = part.along(axis)),
            Pattern::Film(p) => p.axis = axis,
        }
        pattern
    }

    /// Images, and inverses if the family has them, without names.
    fn images(&self, width: usize, height: usize) -> Result<[Vec<Image>; 2], PatternError> {
        if !(1..=MAX_SIDE_PX).contains(&width) || !(1..=MAX_SIDE_PX).contains(&height) {
            return Err(PatternError::Size { width, height });
        }
        Ok(match self {
            Pattern::Sinusoid(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Triangle(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Ramp(p) => [p.generate(width, height), Vec::new()],
            Pattern::Random(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Gray(p) => p.generate(width, height),
            Pattern::Binary(p) => p.generate(width, height),
            Pattern::Xor(p) => p.generate(width, height)?,
            Pattern::Phase(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Mps(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Hilbert(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Alacarte(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Rgb(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Film(p) => [p.generate(width, height)?, Vec::new()],
        })
    }

    fn stem(&self) -> String {
        match self {
            Pattern::Sinusoid(_) => "sine".into(),
            Pattern::Triangle(_) => "triangle".into(),
            Pattern::Ramp(_) => "ramp".into(),
            Pattern::Random(_) => "random".into(),
            Pattern::Gray(p) => format!("gray_{}", p.axis.letter()),
            Pattern::Binary(p) => format!("binary_{}", p.axis.letter()),
            Pattern::Xor(p) => format!("xor_{}", p.axis.letter()),
            Pattern::Phase(p) => format!("phase_{}", p.axis.letter()),
            Pattern::Mps(p) => format!("mps_{}", p.axis.letter()),
            Pattern::Hilbert(p) => format!("hilbert_{}", p.axis.letter()),
            Pattern::Alacarte(p) => format!("alacarte_{}", p.axis.letter()),
            Pattern::Rgb(_) => "rgb".into(),
            Pattern::Film(_) => "film".into(),
        }
    }
}

/// The images of a set of patterns, in order, named by family and numbered through the set: `sine_00`, `sine_01`, …
///
/// # Errors
///
/// A size or a setting out of its range, or inverses for only some of the images.
pub fn generate(patterns: &[Pattern], width: usize, height: usize) -> Result<PatternImages, PatternError> {
    let mut set = PatternImages::default();
    let mut next: HashMap<String, usize> = HashMap::new();
    for pattern in patterns {
        let stem = pattern.stem();
        let first = next.entry(stem.clone()).or_default();
        let [images, inverse] = pattern.images(width, height)?;
        let count = images.len();
        let named = |(i, image): (usize, Image), infix: &str| PatternImage {
            name: format!("{stem}{infix}_{:02}", *first + i),
            image,
        };
        set.images.extend(images.into_iter().enumerate().map(|i| named(i, "")));
        set.inverse.extend(inverse.into_iter().enumerate().map(|i| named(i, "_inv")));
        *first += count;
    }
    if !set.inverse.is_empty() && set.inverse.len() != set.images.len() {
        return Err(PatternError::PartialInverse);
    }
    Ok(set)
}

/// An image that changes along `axis` only: `value` of the pixel's index along it.
fn along(axis: Axis, width: usize, height: usize, value: impl Fn(usize) -> f64) -> Image {
    let line: Vec<f32> = (0..axis.length(width, height)).map(|i| value(i).clamp(0.0, 1.0) as f32).collect();
    let data = match axis {
        Axis::X => (0..height).flat_map(|_| line.iter().copied()).collect(),
        Axis::Y => line.iter().flat_map(|&v| std::iter::repeat_n(v, width)).collect(),
    };
    Image { width, height, channels: 1, data }
}

/// Checks that a period is one a pixel grid can hold.
fn check_period(family: &'static str, key: &'static str, value: f64) -> Result<(), PatternError> {
    if (2.0..=1e6).contains(&value) {
        return Ok(());
    }
    Err(PatternError::Setting { family, key, value, remedy: "give a period of 2 px or more" })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of each family.
    fn all() -> Vec<Pattern> {
        let sinusoid = Sinusoid { axis: Axis::Y, period_px: 12.5, steps: 3 };
        let triangle = Triangle { axis: Axis::X, period_px: 20.0 };
        let random = Random { axis: Axis::X, min_period_px: 8.0, max_period_px: 40.0, seed: 3 };
        vec![
            Pattern::Sinusoid(sinusoid),
            Pattern::Triangle(triangle),
            Pattern::Ramp(Ramp { axis: Axis::X }),
            Pattern::Random(random),
            Pattern::Gray(Gray { axis: Axis::X, inverse: false }),
            Pattern::Binary(Binary { axis: Axis::Y, inverse: false }),
            Pattern::Xor(Xor { axis: Axis::X, base_px: 2, inverse: true }),
            Pattern::Phase(PhaseShift { axis: Axis::X, periods_px: vec![20.0, 50.0], steps: vec![3, 4] }),
            Pattern::Mps(Mps { frequencies: 3, ..Mps::default() }),
            Pattern::Hilbert(Hilbert { axis: Axis::X, count: 3 }),
            Pattern::Alacarte(Alacarte { max_frequency: 2.0, iterations: 3, ..Alacarte::default() }),
            Pattern::Film(Film::default()),
            Pattern::Rgb(Rgb {
                parts: [
                    Box::new(Pattern::Triangle(triangle)),
                    Box::new(Pattern::Random(random)),
                    Box::new(Pattern::Ramp(Ramp { axis: Axis::Y })),
                ],
            }),
        ]
    }

    #[test]
    fn every_family_makes_normalized_images_of_any_size() {
        for pattern in all() {
            for (w, h) in [(1, 1), (1, 9), (97, 5), (640, 3)] {
                let made = pattern.generate(w, h).unwrap();
                assert!(!made.images.is_empty(), "{pattern:?}");
                for p in &made.images {
                    let i = &p.image;
                    assert_eq!((i.width, i.height, i.data.len()), (w, h, w * h * i.channels), "{pattern:?}");
                    assert!(i.data.iter().all(|v| (0.0..=1.0).contains(v)), "{pattern:?}");
                }
                assert_eq!(made, pattern.resolved(w, h).unwrap().generate(w, h).unwrap());
            }
            assert!(matches!(pattern.generate(0, 4), Err(PatternError::Size { .. })));
            assert!(matches!(pattern.generate(4, usize::MAX), Err(PatternError::Size { .. })));
        }
    }

    #[test]
    fn settings_survive_a_file() {
        for pattern in all() {
            let text = toml::to_string(&pattern).unwrap();
            assert_eq!(toml::from_str::<Pattern>(&text).unwrap(), pattern, "{text}");
        }
        let wrong = "family = \"ramp\"\naxis = \"x\"\nperiod = 3";
        assert!(toml::from_str::<Pattern>(wrong).unwrap_err().to_string().contains("period"));
    }

    #[test]
    fn names_are_numbered_through_a_set() {
        let sine = |period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 2 });
        let set = generate(&[sine(8.0), Pattern::Ramp(Ramp::default()), sine(16.0)], 32, 2).unwrap();
        let names: Vec<_> = set.images.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["sine_00", "sine_01", "ramp_00", "sine_02", "sine_03"]);
    }

    #[test]
    fn inverses_are_for_all_or_none() {
        let gray = Pattern::Gray(Gray { axis: Axis::X, inverse: true });
        assert_eq!(generate(&[gray, Pattern::Ramp(Ramp::default())], 8, 8), Err(PatternError::PartialInverse));
    }
}
