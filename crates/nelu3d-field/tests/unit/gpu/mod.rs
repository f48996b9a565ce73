//! Tests that need a GPU, be it a software driver; without any they say that they skip.

mod bench;
mod field;
mod program;
mod surface;
pub(crate) mod test_device;
