//! What a net shares with its surroundings.

use super::super::program::Buffer;

/// Where a net finds what changes from step to step.
pub(in super::super) struct Shared<'a> {
    /// Numbers of things.
    pub(in super::super) control: &'a Buffer<u32>,
    /// Which of them is the number of points.
    pub(in super::super) n_at: usize,
    /// Rates of the optimizers.
    pub(in super::super) rates: &'a Buffer<f32>,
    /// Where this net's are: table, network, root.
    pub(in super::super) rates_at: usize,
}

/// The gradient by the outputs, on the way back.
pub(in super::super) enum Back<'a> {
    /// [`Net::d_out`].
    Outputs,
    /// The gradient of one signed distance, not of a loss. The loss has the gradient s by the distance and u by its
    /// gradient: see `surface/block.rs`.
    Distance {
        /// s, per point.
        s: &'a Buffer,
        /// u, per point, xyz and a fourth that is not read.
        u: &'a Buffer<[f32; 4]>,
    },
}
