//! Buffers, kernels, and lists of kernels that are run one after the other.

mod buffer;
mod constants;
mod kernels;
mod memory;
mod pipeline;
mod queue;
mod wait;

pub(crate) use buffer::{Binding, Buffer};
pub(crate) use constants::{Constants, FOLD, PLACE, folded};
pub(crate) use kernels::{Call, Kernels};
pub(crate) use memory::BufferMemory;
pub(crate) use pipeline::Compiled;

#[cfg(test)]
mod tests;
