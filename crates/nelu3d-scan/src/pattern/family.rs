//! The families in one type, and the images of a set of patterns.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::alacarte::Alacarte;
use super::axis::Axis;
use super::binary::Binary;
use super::error::{MAX_SIDE_PX, PatternError};
use super::film::Film;
use super::gray::Gray;
use super::hilbert::Hilbert;
use super::mps::Mps;
use super::phase::PhaseShift;
use super::ramp::Ramp;
use super::random::Random;
use super::rgb;
use super::sinusoid::Sinusoid;
use super::superposition::Superposition;
use super::triangle::Triangle;
use super::xor::Xor;
use crate::image::Image;

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
    /// Thirds of the columns, whose light adds up: for measuring a camera's response.
    Superposition(Superposition),
    /// Three patterns as the channels of one.
    Rgb(Rgb),
    /// A strip of color film.
    Film(Film),
}

/// Three patterns as red, green and blue. A color camera sees all of them in one capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rgb {
    /// The patterns in red, green and blue; each makes the same number of images.
    pub parts: [Box<Pattern>; 3],
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
    /// Makes the images of this family alone.
    ///
    /// # Errors
    ///
    /// As [`generate`].
    pub fn generate(&self, width: usize, height: usize) -> Result<PatternImages, PatternError> {
        generate(std::slice::from_ref(self), width, height)
    }

    /// Returns whether its images have three channels, which only a color camera can tell apart.
    pub fn is_color(&self) -> bool {
        matches!(self, Pattern::Rgb(_) | Pattern::Film(_))
    }

    /// Returns the pattern with every setting that was left to the size of the image written out.
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
            | Pattern::Superposition(_)
            | Pattern::Film(_) => self.clone(),
        })
    }

    /// Returns the pattern along another axis.
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
            Pattern::Superposition(p) => p.axis = axis,
            Pattern::Rgb(p) => p.parts.iter_mut().for_each(|part| **part = part.along(axis)),
            Pattern::Film(p) => p.axis = axis,
        }
        pattern
    }

    /// Makes the images, and inverses if the family has them, without names.
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
            Pattern::Superposition(p) => [p.generate(width, height)?, Vec::new()],
            Pattern::Rgb(Rgb { parts: [r, g, b] }) => {
                let images = |part: &Pattern| part.images(width, height).map(|[images, _]| images);
                [rgb::interleave([images(r)?, images(g)?, images(b)?])?, Vec::new()]
            }
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
            Pattern::Superposition(_) => "superposition".into(),
            Pattern::Rgb(_) => "rgb".into(),
            Pattern::Film(_) => "film".into(),
        }
    }
}

/// Makes the images of a set of patterns, in order, named by family and numbered through the set: `sine_00`, `sine_01`,
/// …
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
