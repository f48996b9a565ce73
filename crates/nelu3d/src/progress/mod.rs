//! Progress of long work: reports to the caller, cancellation by the caller, and the time that each stage took.

mod sink;
mod stages;

pub use sink::{Progress, Sink};
pub use stages::{StageClock, StageTime};
