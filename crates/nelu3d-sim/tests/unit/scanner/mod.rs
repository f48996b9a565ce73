//! The virtual scanner: its light, its optics, the rigs that it writes, and scenes that move.

mod common;

mod optics;
mod radiance;
mod rig;
mod sequence;
