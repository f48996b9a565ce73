//! The program from outside, one concern a module: `cargo test --release --test program accuracy` runs one of them.
//!
//! They are one binary: each binary is linked with all of the libraries, which takes as long as many a test.

mod common;

mod accuracy;
mod architecture;
mod board;
mod browser;
mod camera;
#[cfg(feature = "capture")]
mod capture;
mod cli;
mod colors;
mod decode;
mod defects;
mod drift;
mod errors;
mod experiment;
#[cfg(feature = "capture")]
mod follow;
mod import;
mod mistakes;
mod neural;
mod patterns;
#[cfg(feature = "capture")]
mod response;
mod resume;
mod scene_light;
mod sequence;
mod table;
