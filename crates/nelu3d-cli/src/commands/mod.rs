//! One module per command: what was typed becomes what it means, then the library does the work.

pub(crate) mod bench;
pub(crate) mod board;
pub(crate) mod calibrate;
pub(crate) mod camera;
#[cfg(feature = "capture")]
pub(crate) mod capture;
pub(crate) mod check;
pub(crate) mod decode;
pub(crate) mod demo;
pub(crate) mod devices;
pub(crate) mod evaluate;
pub(crate) mod import;
mod job;
pub(crate) mod manual;
pub(crate) mod patterns;
pub(crate) mod projector;
pub(crate) mod reconstruct;
pub(crate) mod sequence;
pub(crate) mod simulate;
pub(crate) mod table;
