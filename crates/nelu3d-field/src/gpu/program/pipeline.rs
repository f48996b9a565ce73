//! Compiled kernels.

use std::collections::HashMap;
use std::sync::Mutex;

/// A kernel, compiled.
#[derive(Clone, Debug)]
pub struct Kernel {
    pub(super) label: &'static str,
    pub(super) pipeline: wgpu::ComputePipeline,
}

/// Kernels, by their complete text.
pub(crate) type Compiled = Mutex<HashMap<String, Kernel>>;
