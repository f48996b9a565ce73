//! Decoders of sinusoidal codes, pixel by pixel: from normalized intensities and their noise to a column and its 1σ.
//!
//! | decoder | code | unwrapping |
//! |---|---|---|
//! | [`PhaseDecoder`] | three or more shifts of each frequency | all phases |
//! | [`MpsDecoder`] | three or more shifts of one frequency, one image of each other | the cosines of the others |
//!
//! Both solve for the phase of a frequency by linear least squares ([`PhaseSolver`]), whose noise follows from that of
//! the intensities, and go through all columns of a range that have the finest (the shifted) phase. What to make of the
//! result ([`DecodedColumn`]) is for the caller to say; [`DecodedColumn::is_reliable`] is the usual judgment.

mod column;
mod group;
mod mps;
mod phase;
mod solver;

pub use column::DecodedColumn;
pub use group::{WaveGroup, WaveImage};
pub use mps::MpsDecoder;
pub use phase::{PhaseDecoder, repeats_after};
pub use solver::{MeasuredPhase, PhaseSolver, wrap_angle};
