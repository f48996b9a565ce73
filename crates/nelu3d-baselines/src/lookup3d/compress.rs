//! From a table to its low-rank form: a truncated singular value decomposition per channel, and one of the depth.
//!
//! The matrix of a channel has a row per pixel and a column per position. P is small, so the decomposition goes through
//! the P × P Gram matrix: AᵀA = V Λ Vᵀ exactly (in f64), then R = V_rᵀ and L = A V_r, which is the best rank-r
//! approximation.
//!
//! A decomposition needs every entry. Missing samples between others of the same pixel are filled by linear
//! interpolation over the position, those before the first and after the last by the nearest one. The latter are never
//! chosen when decoding: the range of positions between them is kept beside the factors. Pixels without any sample take
//! no part.

use nalgebra::{DMatrix, SymmetricEigen};
use rayon::prelude::*;

use super::full::FullTable;
use super::low_rank::LowRank;
use super::shape::TableShape;

/// How many terms to keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rank {
    /// As few as leave out, in no channel, more than the noise of the table's own entries (RMS).
    Auto,
    /// So many, at most one per position.
    Fixed(usize),
}

/// A low-rank form and what it cost.
#[derive(Clone, Debug)]
pub struct Compressed {
    /// The factors.
    pub table: LowRank,
    /// RMS of what each channel lost, in normalized intensity.
    pub rms: Vec<f64>,
    /// RMS of what the depth lost, mm.
    pub depth_rms_mm: f64,
    /// The noise of an entry that [`Rank::Auto`] went by, 1σ.
    pub noise: f64,
}

/// RMS to which the depth is kept, mm: less than a board's pose is known to.
const DEPTH_RMS_MM: f64 = 0.01;
/// Pixels that are summed before anything else.
const CHUNK: usize = 4096;

/// Compresses a table.
pub fn compress(table: &FullTable, rank: Rank) -> Compressed {
    let shape = table.shape;
    let TableShape { n_positions: p, k, .. } = shape;
    let spectra: Vec<Spectrum> = (0..=k).map(|j| Spectrum::of(table, j)).collect();
    // What is not known from the sensor is told by the smallest quarter of the spectrum: white noise is all that
    // reaches it.
    let tail = |s: &Spectrum| s.values[p - (p / 4).max(1)..].iter().sum::<f64>() / (p / 4).max(1) as f64 / s.n;
    let variance = match f64::from(table.variance) {
        v if v > 0.0 => v,
        _ => spectra[..k].iter().map(tail).sum::<f64>() / k as f64,
    };
    let chosen = match rank {
        Rank::Fixed(r) => r.clamp(1, p),
        Rank::Auto => spectra[..k].iter().map(|s| s.rank_for(variance)).max().unwrap_or(1),
    };
    let depth_rank = match rank {
        // All terms are asked for: nothing may be lost.
        Rank::Fixed(r) if r >= p => p,
        _ => spectra[k].rank_for(DEPTH_RMS_MM * DEPTH_RMS_MM).min(chosen.max(4)),
    };
    let mut out = LowRank::zeros(shape, chosen, depth_rank);
    out.variance = table.variance;
    let row_len = out.row_len();
    let stride = shape.stride();
    for (j, s) in spectra[..k].iter().enumerate() {
        for i in 0..chosen {
            let right = &mut out.right[(j * chosen + i) * stride..][..p];
            right.iter_mut().enumerate().for_each(|(q, r)| *r = s.vectors[(q, i)] as f32);
        }
    }
    for i in 0..depth_rank {
        let right = &mut out.right_depth[i * p..][..p];
        right.iter_mut().enumerate().for_each(|(q, r)| *r = spectra[k].vectors[(q, i)] as f32);
    }
    let rows = out.left.par_chunks_mut(row_len * CHUNK).zip(out.ranges.par_chunks_mut(CHUNK)).enumerate();
    rows.for_each(|(c, (left, ranges))| {
        let mut row = vec![0.0; p];
        for (i, (left, range)) in left.chunks_exact_mut(row_len).zip(ranges).enumerate() {
            let pixel = c * CHUNK + i;
            let codes = table.channel(pixel, 0);
            let first = codes.iter().position(|v| !v.is_nan());
            *range = first
                .map_or([0, 0], |f| [f as u32, codes.iter().rposition(|v| !v.is_nan()).map_or(0, |l| l as u32 + 1)]);
            for (j, s) in spectra.iter().enumerate() {
                let (at, rank) = if j < k { (j * chosen, chosen) } else { (k * chosen, depth_rank) };
                if fill(table.channel(pixel, j), &mut row) {
                    for (i, l) in left[at..at + rank].iter_mut().enumerate() {
                        *l = row.iter().enumerate().map(|(q, v)| v * s.vectors[(q, i)]).sum::<f64>() as f32;
                    }
                }
            }
        }
    });
    Compressed {
        table: out,
        rms: spectra[..k].iter().map(|s| s.lost(chosen).sqrt()).collect(),
        depth_rms_mm: spectra[k].lost(depth_rank).sqrt(),
        noise: variance.sqrt(),
    }
}

/// Eigenvalues, largest first, and eigenvectors (columns) of a channel's Gram matrix, and its number of entries a
/// position.
struct Spectrum {
    values: Vec<f64>,
    vectors: DMatrix<f64>,
    n: f64,
}

impl Spectrum {
    fn of(table: &FullTable, channel: usize) -> Self {
        let p = table.shape.n_positions;
        let n = table.shape.n_pixels();
        // Chunks of fixed size, added in order: the same sums for any number of threads.
        let parts: Vec<(Vec<f64>, usize)> = (0..n.div_ceil(CHUNK))
            .into_par_iter()
            .map(|c| {
                let (mut gram, mut count, mut row) = (vec![0.0; p * p], 0, vec![0.0; p]);
                for pixel in c * CHUNK..n.min((c + 1) * CHUNK) {
                    if fill(table.channel(pixel, channel), &mut row) {
                        count += 1;
                        for (a, line) in gram.chunks_exact_mut(p).enumerate() {
                            let v = row[a];
                            line[..=a].iter_mut().zip(&row).for_each(|(g, r)| *g += v * r);
                        }
                    }
                }
                (gram, count)
            })
            .collect();
        let mut gram = vec![0.0; p * p];
        let mut count = 0;
        for (part, n) in &parts {
            gram.iter_mut().zip(part).for_each(|(g, v)| *g += v);
            count += n;
        }
        let matrix = DMatrix::from_fn(p, p, |a, b| if a >= b { gram[a * p + b] } else { gram[b * p + a] });
        let eigen = SymmetricEigen::new(matrix);
        let mut order: Vec<usize> = (0..p).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        Self {
            values: order.iter().map(|i| eigen.eigenvalues[*i].max(0.0)).collect(),
            vectors: DMatrix::from_fn(p, p, |r, c| eigen.eigenvectors[(r, order[c])]),
            n: (count as f64).max(1.0),
        }
    }

    /// Mean square of what the first `rank` terms leave.
    fn lost(&self, rank: usize) -> f64 {
        self.values[rank..].iter().sum::<f64>() / (self.n * self.values.len() as f64)
    }

    /// The fewest terms that leave no more than that.
    fn rank_for(&self, mean_square: f64) -> usize {
        (1..self.values.len()).find(|r| self.lost(*r) <= mean_square).unwrap_or(self.values.len())
    }
}

/// A pixel's values with what is missing filled; `false` if there is none.
fn fill(values: &[f32], out: &mut [f64]) -> bool {
    let mut last: Option<usize> = None;
    for (i, v) in values.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
        let v = f64::from(*v);
        out[i] = v;
        match last {
            None => out[..i].fill(v),
            Some(l) => {
                for q in l + 1..i {
                    let f = (q - l) as f64 / (i - l) as f64;
                    out[q] = out[l] * (1.0 - f) + v * f;
                }
            }
        }
        last = Some(i);
    }
    if let Some(l) = last {
        let v = out[l];
        out[l + 1..].fill(v);
    }
    last.is_some()
}
