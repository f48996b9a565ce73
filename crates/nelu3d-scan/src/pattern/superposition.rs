//! Images whose light adds up, for measuring how a camera's codes follow light.

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::PatternError;
use crate::image::Image;

/// Stripes in thirds of the columns, alone, in pairs, and all three, at three brightnesses.
///
/// The columns are dealt to three parts in turn, a stripe each. At each brightness seven images show the parts that the
/// bits of 1 to 7 name: 1, 2, 1 + 2, 3, 1 + 3, 2 + 3, and all. A pixel is either black or at that brightness, so
/// whatever code makes whatever light, the light of a sum is the sum of the light of its parts, at every pixel of a
/// camera, in focus or not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Superposition {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Width of a stripe, px.
    #[serde(default = "stripe")]
    #[cfg_attr(feature = "clap", arg(long = "stripe", value_name = "PX", default_value_t = stripe()))]
    pub stripe_px: u32,
}

/// The brightnesses, brightest first. Light sources whose light follows code^2.2 show the last as a tenth of the first.
const BRIGHTNESS: [f64; 3] = [1.0, 0.6, 0.35];
/// Number of parts.
const PARTS: usize = 3;
/// Images of a brightness: all choices of parts but none.
const CHOICES: usize = (1 << PARTS) - 1;

/// The finest: what tells something is the blur of stripes into each other.
fn stripe() -> u32 {
    1
}

impl Default for Superposition {
    fn default() -> Self {
        Self { axis: Axis::X, stripe_px: stripe() }
    }
}

impl Superposition {
    /// Number of brightnesses.
    pub const LEVELS: usize = BRIGHTNESS.len();
    /// Number of images.
    pub const IMAGES: usize = Self::LEVELS * CHOICES;

    /// Returns what adds up: two images, and the one of both together, by their places.
    pub fn sums() -> Vec<[usize; 3]> {
        let pairs = (1..=CHOICES).flat_map(|a| (a + 1..=CHOICES).map(move |b| (a, b))).filter(|(a, b)| a & b == 0);
        let pairs: Vec<(usize, usize)> = pairs.collect();
        let at = |level: usize, parts: usize| level * CHOICES + parts - 1;
        let of = |level: usize| pairs.iter().map(move |&(a, b)| [at(level, a), at(level, b), at(level, a | b)]);
        (0..Self::LEVELS).flat_map(of).collect()
    }

    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        let stripe_px = self.stripe_px as usize;
        if !(1..=1000).contains(&stripe_px) {
            let (key, value) = ("stripe_px", f64::from(self.stripe_px));
            return Err(PatternError::Setting { family: "superposition", key, value, remedy: "give 1 to 1000 px" });
        }
        let image = |level: f64, parts: usize| {
            let lit = move |u: usize| parts >> (u / stripe_px % PARTS) & 1 == 1;
            along(self.axis, width, height, |u| if lit(u) { level } else { 0.0 })
        };
        Ok(BRIGHTNESS
            .iter()
            .flat_map(|&level| (1..=CHOICES).map(move |parts| (level, parts)))
            .map(|(l, p)| image(l, p))
            .collect())
    }
}
