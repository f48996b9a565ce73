//! What the stages of recipe `fast` ask of the machine, for `nelu3d bench`: floating-point operations, and bytes from
//! and to main memory in order. Counted by hand from the code; of a loop that reads single pixels here and there, only
//! the maps that it reads and writes count.

use nelu3d_field::bench::Demand;

/// Bytes of a value.
const F32: f64 = 4.0;

/// Returns the demand of normalizing `n` pixels of k pattern channels and `channels` color channels.
pub(super) fn normalization(n: usize, k: usize, channels: usize) -> Demand {
    let (n, k, channels) = (n as f64, k as f64, channels as f64);
    // Quotient and variance of each channel; then its surroundings, two means over squares of two maps, along rows and
    // columns.
    let flops = n * (12.0 * k + 2.0 * channels + k * (2.0 * 2.0 * 2.0 * 3.0 + 2.0));
    let bytes = n * F32 * ((k + 2.0 * channels) + (3.0 * k + 2.0 + channels) + k * (2.0 + 2.0 * 2.0 * 2.0 * 2.0));
    Demand { flops, bytes, ..Demand::default() }
}

/// Returns the demand of the filter, which compares the maps of `n` pixels with those beside them.
pub(super) fn filter(n: usize, k: usize) -> Demand {
    Demand { flops: 30.0 * n as f64, bytes: n as f64 * F32 * (12.0 + k as f64), ..Demand::default() }
}

/// Returns the demand of links, normals and triangles of `n` pixels.
pub(super) fn mesh(n: usize) -> Demand {
    Demand { flops: 60.0 * n as f64, bytes: n as f64 * F32 * 16.0, ..Demand::default() }
}
