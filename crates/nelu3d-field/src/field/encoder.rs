//! The interface of an encoding to the network behind it.

/// The part in which the forms of a field differ: how points become network inputs, and what becomes of their
/// gradients.
///
/// The functions of an encoder are called from dispatched code: implementations are `#[inline(always)]`.
pub(super) trait Encoder<const D: usize>: Sync {
    /// Memory of one task.
    type Scratch: Send;

    /// Makes the memory for tasks whose gradients are collected for up to `n_points` points; 0 for queries.
    fn scratch(&self, n_points: usize) -> Self::Scratch;

    /// Writes the network inputs of at most a block of points, `stride` values apart. What lies behind a row's inputs
    /// is zero and stays it.
    fn encode(&self, points: &[[f32; D]], scratch: &mut Self::Scratch, x: &mut [f32], stride: usize);

    /// Keeps the gradients of the inputs of a block, whose first point is number `first` of the task's `n_points`.
    fn collect(&self, first: usize, n_points: usize, d_x: &[f32], stride: usize, scratch: &mut Self::Scratch);
}
