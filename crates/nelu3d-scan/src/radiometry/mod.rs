//! How a camera's codes follow light, measured: from images of a still scene whose light is known to add up, or to
//! stand in known ratios.
//!
//! ```text
//! images of a still scene ──► ResponseEstimator::add ──► finish ──► Response, ResponseReport
//! relations: Σ weight · light = 0
//! ```
//!
//! Nothing is known of how bright the scene is, nor of how the light source makes light of its codes. Known is only that
//! light adds: a pixel that sees two halves of a pattern, one after the other, sees as much as it does of both at once.
//! Every such [`LightRelation`] is linear in the light, so it may be averaged over a block of pixels however sharp the
//! pattern is in the picture, and only the right curve from codes to light makes all of them come out at zero (the
//! method of superposition, by which photometers are tested; and with exposure times for weights, that of P. E. Debevec
//! and J. Malik, SIGGRAPH 1997).
//!
//! The curve rises everywhere, is smooth, and has as few parameters as relations that were left out ask for.
//!
//! A file imports only from above it here: `error`, `relation`; `rows`, `curve`; `fit`; `report`; `estimator`.

mod curve;
mod error;
mod estimator;
mod fit;
mod relation;
mod report;
mod rows;

pub use error::ResponseError;
pub use estimator::ResponseEstimator;
pub use relation::LightRelation;
pub use report::{CandidateCurve, ResponseReport};
