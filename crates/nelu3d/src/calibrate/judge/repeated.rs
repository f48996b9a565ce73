//! Positions whose images are the same, value for value: a camera that returned old frames, or files that were copied.
//! Noise makes any two captures differ.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher as _};

use nelu3d_scan::Image;

use crate::verdict::{Code, Finding, Verdict};

/// About how many values of an image are compared.
const VALUES: usize = 20_000;

/// A hash of a position's images, equal where they are.
#[derive(Clone, Default)]
pub struct Fingerprint(DefaultHasher);

impl Fingerprint {
    /// Adds an image. Positions add theirs in the same order.
    pub fn add(&mut self, image: &Image) {
        for v in image.data.iter().step_by((image.data.len() / VALUES).max(1)) {
            self.0.write_u32(v.to_bits());
        }
    }
}

/// Judges positions by their names and fingerprints.
pub fn judge<'a>(positions: impl Iterator<Item = (&'a str, &'a Fingerprint)>) -> Option<Finding> {
    let mut groups = BTreeMap::<u64, Vec<&str>>::new();
    for (name, f) in positions {
        groups.entry(f.0.finish()).or_default().push(name);
    }
    let same: Vec<&str> = groups.into_values().filter(|g| g.len() > 1).max_by_key(Vec::len)?;
    let sentence = match same[..] {
        [a, b] => format!("the images of the board positions {a} and {b} are the same"),
        _ => {
            format!("the images of {} board positions are the same, {} and {} among them", same.len(), same[0], same[1])
        }
    };
    let remedy = "take every position's images anew, and check that the camera delivers each frame once";
    Some(Finding::new(Code::PositionsRepeat, Verdict::Doubtful, sentence, remedy).with("positions", same))
}
