//! How much memory buffers take.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Memory of buffers, bytes.
#[derive(Debug, Default)]
pub(crate) struct BufferMemory {
    pub(super) now: AtomicU64,
    pub(super) peak: AtomicU64,
}

/// Memory of one buffer, as long as there is one.
#[derive(Debug)]
pub struct Held {
    bytes: u64,
    memory: Arc<BufferMemory>,
}

impl Held {
    /// Counts a buffer's memory until it is dropped.
    pub(super) fn new(bytes: u64, memory: &Arc<BufferMemory>) -> Arc<Self> {
        let now = memory.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
        memory.peak.fetch_max(now, Ordering::Relaxed);
        Arc::new(Self { bytes, memory: memory.clone() })
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.memory.now.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}
