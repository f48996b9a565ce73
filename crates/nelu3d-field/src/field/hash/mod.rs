//! The form `hash`: a multiresolution hash grid and a network (Müller et al. 2022).

mod config;
mod encoder;
mod field;
mod kernels;
mod query;
mod state;
mod train;

pub use config::HashFieldConfig;
pub use field::HashField;
