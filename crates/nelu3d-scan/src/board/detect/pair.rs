//! What the coarse detectors find.

/// A point of the board (mm) and the pixel at which it was coarsely seen.
pub(super) type Pair = ([f64; 2], [f64; 2]);
