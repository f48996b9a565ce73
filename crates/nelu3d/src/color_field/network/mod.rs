//! The common part of the forms with a network: their state and checkpoint ([`NetworkForm`], [`NetworkShape`]), the
//! samples that they are trained on, and how they become a spline.
//!
//! To add such a form: implement [`Network`](contract::Network) for its network, and write settings with a `train` of
//! their own, as [`super::hash`], [`super::frequency`] and [`super::published`] do.

mod contract;
mod form;
mod samples;
mod spline;

pub(super) use form::{NetworkForm, NetworkShape};
pub(super) use samples::{SampleBatch, TrainingSamples};
