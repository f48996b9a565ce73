//! The common part of the forms with a network: their state and checkpoint ([`NetworkForm`], [`NetworkShape`]), the
//! samples that they are trained on, and how they become a spline.
//!
//! To add such a form: implement [`Network`](contract::Network) for its network, and write settings with a `train` of
//! their own, as [`super::hash`] and [`super::frequency`] do.

mod contract;
mod form;
mod samples;
mod spline;

pub(super) use form::{NetworkForm, NetworkShape};
#[cfg(feature = "gpu")]
pub(super) use samples::SampleBatch;
pub(super) use samples::TrainingSamples;
