//! Frequency encoding (Mildenhall et al. 2020, Eq. 4): per axis a and level k, sin(2^k π x_a) and cos(2^k π x_a).
//!
//! Features of a point: `[axis][level][sin, cos]`, so `2 · D · n_frequencies` of them. No parameters.

pub mod cpu;
pub mod reference;

use serde::{Deserialize, Serialize};

/// Shape of the encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frequency {
    /// Number of octaves per axis. Beyond 24, single-precision points no longer vary within a period.
    pub n_frequencies: usize,
}

impl Frequency {
    /// Returns the length of a feature vector of a point with `n_axes` coordinates.
    pub fn n_features(self, n_axes: usize) -> usize {
        2 * n_axes * self.n_frequencies
    }
}
