//! Projected patterns: what to show, as pure functions of a size. One file per family.
//!
//! Every family promises: images of the asked size, one channel ([`Rgb`] and [`Film`] three), values in `[0, 1]` linear
//! in light, the same images for the same settings. To add one, write its file, add it to [`Pattern`] and to the tests'
//! list.

mod alacarte;
mod axis;
mod binary;
mod bits;
mod codewords;
mod decoder;
mod error;
mod family;
mod film;
mod gray;
mod hilbert;
mod mps;
mod noise;
mod phase;
mod ramp;
mod random;
mod recommended;
mod rgb;
mod score;
mod sinusoid;
mod superposition;
mod triangle;
mod wave;
mod xor;

pub use alacarte::{Alacarte, expected_zncc_error};
pub use axis::Axis;
pub use binary::{Binary, decode_binary};
pub use bits::BitCode;
pub use codewords::{Codewords, Stripes};
pub use decoder::{
    DecodedColumn, MeasuredPhase, MpsDecoder, PhaseDecoder, PhaseSolver, WaveGroup, WaveImage, repeats_after,
    wrap_angle,
};
pub use error::PatternError;
pub use family::{Pattern, PatternImage, PatternImages, Rgb, generate};
pub use film::Film;
pub use gray::{Gray, decode_gray};
pub use hilbert::{Hilbert, hilbert_codewords, hilbert_point};
pub use mps::Mps;
pub use noise::SplitMix;
pub use phase::PhaseShift;
pub use ramp::Ramp;
pub use random::Random;
pub use recommended::{RECOMMENDED_IMAGES, recommended_patterns};
pub use score::{DecodingErrors, Score, ScoreOptions, Sensitivity, Separation, confusion_matrix, score};
pub use sinusoid::Sinusoid;
pub use superposition::Superposition;
pub use triangle::Triangle;
pub use wave::{FittedWave, Wave};
pub use xor::{Xor, decode_xor};
