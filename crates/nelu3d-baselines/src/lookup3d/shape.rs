//! The sizes of a lookup table, and the memory that it takes.

use nelu3d_field::nearest::{self, LANES};

/// Sizes of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableShape {
    /// Pixels of a row of the table: `camera width / step`, rounded up.
    pub width: usize,
    /// Rows: `camera height / step`, rounded up.
    pub height: usize,
    /// Which of the camera's pixels it holds: every `step`th, from the first.
    pub step: usize,
    /// Board positions P.
    pub n_positions: usize,
    /// Channels of a codeword.
    pub k: usize,
}

impl TableShape {
    /// Returns the shape of a table for every `step`th pixel of a picture of `width × height`.
    pub fn of_picture(width: usize, height: usize, step: usize, n_positions: usize, k: usize) -> Self {
        Self { width: width.div_ceil(step), height: height.div_ceil(step), step, n_positions, k }
    }

    /// Pixels.
    pub fn n_pixels(&self) -> usize {
        self.width * self.height
    }

    /// Positions in memory.
    pub(crate) fn stride(&self) -> usize {
        self.n_positions.next_multiple_of(LANES)
    }

    /// Values of a pixel in memory: k channels and the depth.
    pub(crate) fn row_len(&self) -> usize {
        (self.k + 1) * self.stride()
    }

    /// Memory of a full table of this shape, bytes.
    pub fn bytes(&self) -> usize {
        self.n_pixels().saturating_mul(self.row_len()).saturating_mul(size_of::<f32>())
    }

    pub(crate) fn for_kernel(&self) -> nearest::Shape {
        nearest::Shape { n_channels: self.k, n_positions: self.n_positions, stride: self.stride() }
    }
}

/// Returns the memory that is free, in bytes; `None` where the system does not tell.
pub(crate) fn free_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let kib: f64 =
        text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0)
}
