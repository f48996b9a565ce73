//! Buffers, kernels, and lists of kernels that are run one after the other.

mod buffer;
mod constants;
mod kernels;
mod memory;
mod pipeline;
mod queue;
mod wait;

pub use buffer::{Binding, Buffer};
pub(crate) use constants::PLACE;
pub use constants::{Constants, FOLD, folded};
pub use kernels::{Call, Kernels};
pub(crate) use memory::BufferMemory;
pub(crate) use pipeline::Compiled;
pub use pipeline::Kernel;
