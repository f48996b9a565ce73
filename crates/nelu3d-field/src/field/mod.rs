//! An encoding (a hash grid, or frequencies) and a small network over one flat parameter buffer: the engine's seam.
//! Callers train a step, query points, and read or restore the parameters; nothing of the device leaks through.
//!
//! The forms, [`HashField`] in `hash/` and [`FrequencyField`] in `frequency/`, differ in their encoder (`encoder.rs`)
//! and in how parameters are updated; gradients of a step (`regression.rs`) and queries (`query.rs`) are the same for
//! both. A new form brings its own encoder.

pub(crate) mod columns;
mod config;
mod encoder;
mod frequency;
mod hash;
mod query;
mod regression;
pub(crate) mod table;
pub(crate) mod training;

pub use config::{FieldError, RegressionLoss, TrainConfig};
pub use frequency::{FrequencyField, FrequencyFieldConfig};
pub use hash::{HashField, HashFieldConfig};
