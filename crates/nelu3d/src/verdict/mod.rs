//! Whether to trust a result: a verdict, and what it rests on.
//!
//! Stages that measure something (`calibrate/judge/`, `reconstruct/judge/`, `sensor/scene_faults.rs`) add findings to
//! a [`Judgment`]; its verdict is that of the worst. A finding has a stable [`Code`], one sentence that says what is
//! wrong, the numbers that say so, and what to do.
//!
//! A new finding is a variant of [`Code`], a line in `docs/result-format.md`, and a row in the test `mistakes`.

mod code;
mod judgment;

pub use code::Code;
pub use judgment::{Finding, Judgment, Verdict};
