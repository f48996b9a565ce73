//! From bits to columns.

use nelu3d::surface::PixelStatus;
use rayon::prelude::*;

use super::bit::Bit;
use super::table::GrayTable;
use crate::captured::Captured;

/// A bit nearer to its threshold than this many standard deviations of the noise is uncertain.
const CERTAIN: f32 = 3.0;

/// A bit nearer to its threshold than this share of full contrast is uncertain: indirect light turns such bits.
const MIN_DIFFERENCE: f32 = 0.03;

/// Returns the first and last column of every pixel's codeword; first > last where there is none.
pub(super) fn columns(captured: &Captured, table: &GrayTable, bits: &[Bit<'_>]) -> Vec<[u16; 2]> {
    const NONE: [u16; 2] = [1, 0];
    /// Pixels at a time: bit after bit, so that a pass over them is one over an image.
    const CHUNK: usize = 2048;
    let resolve = |word: u32, uncertain: u32| -> [u16; 2] {
        let Some(found) = table.get(word) else { return NONE };
        match uncertain.count_ones() {
            0 => found,
            1 => match table.get(word ^ uncertain) {
                Some(other) if other[0] == found[1] + 1 || found[0] == other[1] + 1 => found,
                // The other value does not occur: it cannot have been meant.
                None => found,
                Some(_) => NONE,
            },
            _ => NONE,
        }
    };
    let mut out = vec![NONE; captured.status.len()];
    out.par_chunks_mut(CHUNK).enumerate().for_each_init(
        || (vec![0.0f32; CHUNK], vec![0u32; CHUNK], vec![0u32; CHUNK]),
        |(limits, words, uncertain), (chunk, out)| {
            let (first, n) = (chunk * CHUNK, out.len());
            let valid = |k: usize| captured.status[first + k] == PixelStatus::Valid;
            for k in 0..n {
                let noise = if valid(k) { captured.variance(first + k, 0.5).sqrt() } else { 0.0 };
                limits[k] = (bits[0].sigma(noise) * CERTAIN).max(MIN_DIFFERENCE);
            }
            words.fill(0);
            uncertain.fill(0);
            for bit in bits {
                let mut add = |k: usize, d: f32| {
                    words[k] = words[k] << 1 | u32::from(d > 0.0);
                    uncertain[k] = uncertain[k] << 1 | u32::from(d.abs() < limits[k]);
                };
                let p = &bit.p[first..first + n];
                match &bit.inverse {
                    Some(inverse) => {
                        let inverse = &inverse[first..first + n];
                        (0..n).for_each(|k| add(k, 0.5 * (p[k] - inverse[k])));
                    }
                    None => (0..n).for_each(|k| add(k, p[k] - 0.5)),
                }
            }
            for k in (0..n).filter(|k| valid(*k)) {
                out[k] = resolve(words[k], uncertain[k]);
            }
        },
    );
    out
}
