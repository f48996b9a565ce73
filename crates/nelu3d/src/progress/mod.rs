//! How long work tells its caller where it stands, how the caller stops it, and how long each stage took.

mod sink;
mod stages;

pub use sink::{Progress, Sink};
pub use stages::{StageClock, StageTime};
