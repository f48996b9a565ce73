//! The form `frequency`: frequency encoding and a network, the field of NeRF (Mildenhall et al. 2020, Sec. 5.1), with
//! as many octaves per axis as wanted. All it knows is in the network, so every step touches every parameter.

mod config;
mod encoder;
mod field;

pub use config::FrequencyFieldConfig;
pub use field::FrequencyField;
