//! Parts of a position's image that are not used.

/// Blocks of pixels of one image that are left out of the sweep: something stood before the board there.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcludedBlocks {
    /// Side of a block, px.
    pub(super) block: usize,
    /// Number of blocks across and down; pixels beyond the last belong to it.
    pub(super) counts: [usize; 2],
    /// True where a block is left out, row by row.
    pub(super) blocks: Vec<bool>,
}

impl ExcludedBlocks {
    /// Returns the fraction of the image that is left out.
    pub(super) fn share(&self) -> f64 {
        self.blocks.iter().filter(|b| **b).count() as f64 / self.blocks.len().max(1) as f64
    }

    /// Returns whether pixel (x, y) is left out.
    #[inline]
    pub fn contains(&self, x: usize, y: usize) -> bool {
        let at = |v: usize, n: usize| (v / self.block).min(n - 1);
        self.blocks[at(y, self.counts[1]) * self.counts[0] + at(x, self.counts[0])]
    }
}
