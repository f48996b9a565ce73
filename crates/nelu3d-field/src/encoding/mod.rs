//! Encodings: from a point in [0, 1]^D to a feature vector that a small network can read.
//!
//! Every encoding promises `forward`, `backward` to its parameters (if it has any) and the derivative of the features
//! by the point. A new one is a folder beside these two, with the same three files.

pub mod frequency;
pub mod hash_grid;
