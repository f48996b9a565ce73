//! How many pixels of a sensor are read, and how many coefficients a field has at most.

/// Most coefficients of a field: 48 million in f16 are 96 MB.
pub(super) const MAX_COEFFS: usize = 48_000_000;
/// Most coefficients of a field where the sensor's pixels are read in blocks: solving for them takes ten times their
/// memory.
pub(super) const MAX_COEFFS_OF_BLOCKS: usize = MAX_COEFFS / 2;
/// Pixels from which a sensor is large.
const LARGE: usize = 16_000_000;
/// Pixels that a sweep of a large sensor is read with, at least: more than a field of three channels has cells then.
const ENOUGH_PIXELS: usize = 3_000_000;

/// Returns the side of the blocks of pixels that are read as one: larger than 1 where the sensor is large, and has four
/// times the pixels that a field of `k` channels has cells across at most, with one cell along, which has four
/// coefficients.
pub fn binning(n_pixels: usize, k: usize) -> usize {
    let side = |pixels: usize| (n_pixels as f64 / pixels as f64).sqrt() as usize;
    let cells = |coeffs: usize| coeffs / (4 * k.max(1));
    if n_pixels < LARGE || side(cells(MAX_COEFFS)) < 2 {
        return 1;
    }
    side(ENOUGH_PIXELS).min(side(cells(MAX_COEFFS_OF_BLOCKS))).max(1)
}
