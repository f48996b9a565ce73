//! Decoders.

pub mod lookup3d;
