//! A frame reduced to what comparing needs.

use nelu3d_scan::image::{Raw, RawData};

use crate::frame::Frame;

/// About as many values of a frame are compared.
const SAMPLES: usize = 300_000;
/// Blocks along the picture's longer side at most.
const BLOCKS: usize = 32;
/// Samples along a block's side at least: their mean square is then known to a fifth.
const MIN_SIDE: usize = 8;

/// Values of a frame on a regular grid, block after block: a difference in any part of the picture stands out in its
/// block.
#[derive(Clone, Debug)]
pub(crate) struct Samples {
    /// The values of each block, channels interleaved.
    blocks: Vec<Vec<f32>>,
    /// Blocks along x: they are numbered row by row.
    columns: usize,
    /// Mean of all values.
    pub(crate) mean: f64,
    /// A number that only bit-identical frames share (but for one pair in 2⁶⁴).
    pub(crate) fingerprint: u64,
}

impl Samples {
    pub(crate) fn of(frame: &Frame) -> Self {
        let raw = &frame.raw;
        let step = ((raw.width * raw.height * raw.channels) as f64 / SAMPLES as f64).sqrt().ceil().max(1.0) as usize;
        let (w, h) = (raw.width.div_ceil(step), raw.height.div_ceil(step));
        let side = (w.max(h).div_ceil(BLOCKS)).max(MIN_SIDE);
        // What remains at the far edges goes to the last whole block.
        let (columns, rows) = ((w / side).max(1), (h / side).max(1));
        let mut blocks = vec![Vec::with_capacity(side * side * raw.channels); columns * rows];
        let mut sum = 0.0;
        for y in 0..h {
            let row = (y / side).min(rows - 1) * columns;
            for x in 0..w {
                let at = (y * step * raw.width + x * step) * raw.channels;
                let block = &mut blocks[row + (x / side).min(columns - 1)];
                for value in (at..at + raw.channels).map(|i| code(raw, i)) {
                    block.push(value);
                    sum += f64::from(value);
                }
            }
        }
        let mean = sum / (w * h * raw.channels) as f64;
        Self { blocks, columns, mean, fingerprint: fingerprint(raw) }
    }

    /// The blocks of two frames, pair by pair. Both must have one size.
    pub(crate) fn pairs<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = (&'a [f32], &'a [f32])> {
        self.blocks.iter().zip(&other.blocks).map(|(a, b)| (a.as_slice(), b.as_slice()))
    }

    /// Means of the blocks' rows, top to bottom.
    pub(crate) fn rows(&self) -> Vec<f64> {
        let mean = |blocks: &[Vec<f32>]| {
            let n: usize = blocks.iter().map(Vec::len).sum();
            blocks.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / n.max(1) as f64
        };
        self.blocks.chunks(self.columns).map(mean).collect()
    }
}

/// Returns a code as a number.
fn code(raw: &Raw, i: usize) -> f32 {
    match &raw.data {
        RawData::U8(v) => f32::from(v[i]),
        RawData::U16(v) => f32::from(v[i]),
        RawData::Float(v) => v[i],
    }
}

/// FNV-1a over all codes.
fn fingerprint(raw: &Raw) -> u64 {
    let mix = |hash: u64, v: u64| (hash ^ v).wrapping_mul(0x0000_0100_0000_01b3);
    let start = 0xcbf2_9ce4_8422_2325;
    match &raw.data {
        RawData::U8(v) => v.iter().fold(start, |h, c| mix(h, u64::from(*c))),
        RawData::U16(v) => v.iter().fold(start, |h, c| mix(h, u64::from(*c))),
        RawData::Float(v) => v.iter().fold(start, |h, c| mix(h, u64::from(c.to_bits()))),
    }
}

/// Mean over a block's values.
pub(crate) fn mean(values: &[f32]) -> f64 {
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len().max(1) as f64
}

/// Mean square difference of two blocks.
pub(crate) fn mean_square_difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64
}
