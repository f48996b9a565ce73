//! A preconditioner that solves for whole lines of coefficients.
//!
//! Most codes are stripes: along them a codeword does not change, nor does it along the light's rays, and the penalty
//! there is thousands of times what samples weigh. Conjugate gradients with a diagonal preconditioner take steps of one
//! node along such lines; of the smoothness that predicts best they then show but a part. Here every channel's equations
//! along its smoother axis across are solved exactly, mode by mode along w, all else by its diagonal.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::modes::Modes;
use super::smoothness::Smoothness;

/// Values of a row of nodes whose lines along b are solved together: with their factors they stay in the second cache.
const WIDTH: usize = 1 << 8;
/// What every node of a line is held by, as a part of the penalty along it. Where samples tell nothing, a line is free to
/// move and turn, and what comes of it is rounding, which grows with the third power of the line's length.
const HOLD: f32 = 1e-6;

/// A matrix for every channel and every mode along w: the normal equations' diagonal and, along the axis across of more
/// smoothness, the whole penalty on second differences, pentadiagonal; as its factors L D Lᵀ.
pub struct Lines {
    modes: Modes,
    /// Values per row of nodes, and per column in it.
    row: usize,
    column: usize,
    /// Of every value of a column: 1 where its lines run along b, 0 where along a.
    along_b: Vec<f32>,
    /// L, `[b][a][mode][channel]`: what a value takes of the one before it on its line, and of the one before that.
    before: [Vec<f32>; 2],
    /// One over D.
    inverse: Vec<f32>,
}

impl Lines {
    /// Factors the matrices. `diag` is the samples' part of the normal equations' diagonal, `[b][a][w][channel]`,
    /// `lambda` the unit of the penalties, channel by channel.
    pub fn new([na, nb, nw]: [usize; 3], mut diag: Vec<f32>, smooth: &Smoothness, lambda: &[f32]) -> Self {
        let k = lambda.len();
        let (column, row) = (nw * k, na * nw * k);
        debug_assert_eq!(diag.len(), nb * row);
        let modes = Modes::new(&mean_along_w(&diag, nw, lambda), k, smooth);
        let along_b: Vec<f32> = smooth.of_channels.iter().map(|[a, b, _]| if a > b { 0.0 } else { 1.0 }).collect();
        // What does not depend on the place, value by value of a column.
        let of_modes = |of: &dyn Fn([f32; 3], f32, f32) -> f32| -> Vec<f32> {
            let modes = modes.along.iter().zip(&modes.squares);
            let of_channels = || smooth.of_channels.iter().zip(lambda);
            modes.flat_map(|(along, square)| of_channels().map(|(f, l)| l * of(*f, *along, *square))).collect()
        };
        let strengths = of_modes(&|[a, b, _], _, square| smooth.across * a.max(b) * square);
        let others = of_modes(&|[a, b, w], along, square| {
            let across = smooth.across * (6.0 * a.min(b) + HOLD * a.max(b));
            (across + 1e-6) * square + along * w
        });
        let along_b = along_b.repeat(nw);
        diag.par_chunks_mut(row).for_each(|d| {
            modes.diagonal(d);
            d.chunks_mut(column).for_each(|d| d.iter_mut().zip(&others).for_each(|(d, other)| *d += other));
        });

        let mut before = [vec![0.0; diag.len()], vec![0.0; diag.len()]];
        let [first, second] = &mut before;
        let of_axis = |axis: f32| -> Vec<f32> {
            strengths.iter().zip(&along_b).map(|(s, b)| if *b == axis { *s } else { 0.0 }).collect()
        };
        if along_b.contains(&0.0) {
            let strengths = of_axis(0.0);
            diag.par_chunks_mut(row).zip(first.par_chunks_mut(row)).zip(second.par_chunks_mut(row)).for_each(
                |((d, first), second)| {
                    let [d, first, second] = [d, first, second].map(|row| row.chunks_mut(column).collect::<Vec<_>>());
                    Arch::new().dispatch(Factor { d, first, second, strengths: &strengths });
                },
            );
        }
        if along_b.contains(&1.0) {
            let strengths = of_axis(1.0).repeat(na);
            let blocks = in_blocks(&mut diag, row).into_par_iter().zip(in_blocks(first, row));
            blocks.zip(in_blocks(second, row)).zip(strengths.par_chunks(WIDTH)).for_each(
                |(((d, first), second), strengths)| {
                    Arch::new().dispatch(Factor { d, first, second, strengths });
                },
            );
        }
        diag.par_iter_mut().for_each(|d| *d = 1.0 / *d);
        Self { modes, row, column, along_b, before, inverse: diag }
    }

    /// Writes M⁻¹ r to `z`, with M the matrices.
    pub fn solve(&self, r: &[f32], z: &mut [f32]) {
        let (row, column) = (self.row, self.column);
        let arch = Arch::new();
        z.par_chunks_mut(row).zip(r.par_chunks(row)).for_each(|(modes, x)| {
            arch.dispatch(Turn { modes: &self.modes, x, y: modes, is_back: false });
        });
        if self.along_b.contains(&1.0) {
            in_blocks(z, row).into_par_iter().enumerate().for_each(|(block, z)| {
                let from = block * WIDTH;
                let mask = (from..from + z[0].len()).map(|i| self.along_b[i % column]).collect();
                arch.dispatch(Solve { lines: self, from, stride: row, mask, z });
            });
        }
        let mask: Vec<f32> = self.along_b.iter().map(|b| 1.0 - b).collect();
        z.par_chunks_mut(row).enumerate().for_each_init(Vec::new, |modes, (b, z)| {
            if mask.contains(&1.0) {
                let columns = z.chunks_mut(column).collect();
                arch.dispatch(Solve { lines: self, from: b * row, stride: column, mask: mask.clone(), z: columns });
            }
            modes.clear();
            modes.extend_from_slice(z);
            arch.dispatch(Turn { modes: &self.modes, x: modes, y: z, is_back: true });
        });
    }
}

/// Columns of coefficients in modes, or of modes in coefficients.
struct Turn<'a> {
    modes: &'a Modes,
    x: &'a [f32],
    y: &'a mut [f32],
    is_back: bool,
}

impl WithSimd for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        if self.is_back { self.modes.back(self.x, self.y) } else { self.modes.to(self.x, self.y) }
    }
}

/// Returns the mean of `[column][w][channel]`, node by node along w, with channels in units of `lambda`.
fn mean_along_w(diag: &[f32], nw: usize, lambda: &[f32]) -> Vec<f32> {
    let k = lambda.len();
    let mut sums = vec![0.0f64; nw * k];
    for column in diag.chunks_exact(nw * k) {
        sums.iter_mut().zip(column).for_each(|(sum, d)| *sum += f64::from(*d));
    }
    let of_node = |sums: &[f64]| sums.iter().zip(lambda).map(|(sum, l)| sum / f64::from(*l)).sum::<f64>();
    let n = (diag.len() / nw) as f64;
    sums.chunks_exact(k).map(|sums| (of_node(sums) / n) as f32).collect()
}

/// Returns rows of values in blocks of [`WIDTH`] columns of them: `[block][row]`.
fn in_blocks(values: &mut [f32], row: usize) -> Vec<Vec<&mut [f32]>> {
    let n_rows = values.len() / row;
    let mut blocks: Vec<Vec<_>> = (0..row.div_ceil(WIDTH)).map(|_| Vec::with_capacity(n_rows)).collect();
    for row in values.chunks_mut(row) {
        blocks.iter_mut().zip(row.chunks_mut(WIDTH)).for_each(|(block, values)| block.push(values));
    }
    blocks
}

/// Returns what DᵀD has of node `i` of a chain of `n`, of the one before it, and of the one before that, where D has the
/// second differences about every inner node.
fn second_differences(i: usize, n: usize) -> [f32; 3] {
    let inner = |mid: usize| if (1..n.saturating_sub(1)).contains(&mid) { 1.0 } else { 0.0 };
    let before = if i > 0 { inner(i - 1) } else { 0.0 };
    let own = before + 4.0 * inner(i) + inner(i + 1);
    [own, if i > 0 { -2.0 * (before + inner(i)) } else { 0.0 }, if i > 1 { before } else { 0.0 }]
}

/// The factors of lines side by side, node after node.
struct Factor<'a> {
    /// The matrix's diagonal without the penalty along the lines, `[node][value]`; becomes D.
    d: Vec<&'a mut [f32]>,
    first: Vec<&'a mut [f32]>,
    second: Vec<&'a mut [f32]>,
    /// The penalty's strength, value by value; 0 for what has no line here, and stays.
    strengths: &'a [f32],
}

impl WithSimd for Factor<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { mut d, mut first, mut second, strengths } = self;
        let n = d.len();
        // The recursion goes in double precision: its errors grow along a line as those of what it solves do.
        let mut before = vec![Before { d: [1.0; 2], first: 0.0 }; strengths.len()];
        for i in 0..n {
            let [own, one, two] = second_differences(i, n).map(f64::from);
            let values = d[i].iter_mut().zip(first[i].iter_mut()).zip(second[i].iter_mut());
            for ((((d, first), second), before), s) in values.zip(&mut before).zip(strengths) {
                let (Before { d: [d1, d2], first: last }, s) = (*before, f64::from(*s));
                let l2 = s * two / d2;
                let l1 = (s * one - l2 * d2 * last) / d1;
                // Without rounding D is never less than what the penalty is added to.
                let with = (f64::from(*d) + s * own - l1 * l1 * d1 - l2 * l2 * d2).max(f64::from(*d));
                *before = Before { d: [with, d1], first: l1 };
                let has_line = s > 0.0;
                *d = if has_line { with as f32 } else { *d };
                *first = if has_line { l1 as f32 } else { *first };
                *second = if has_line { l2 as f32 } else { *second };
            }
        }
    }
}

/// What the factors of a value follow from: D of the one before it on its line and of the one before that, and what the
/// former takes of the latter.
#[derive(Clone, Copy)]
struct Before {
    d: [f64; 2],
    first: f64,
}

/// The solution of lines side by side.
struct Solve<'a> {
    lines: &'a Lines,
    /// Where the lines' first values begin in the lattice, and how far the next ones are.
    from: usize,
    stride: usize,
    /// Of every value, 1 if it has a line here; others stay.
    mask: Vec<f32>,
    /// The right side, `[node][value]`; becomes the solution.
    z: Vec<&'a mut [f32]>,
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { lines, from, stride, mask, mut z } = self;
        let [first, second] = &lines.before;
        let n = z.len();
        for i in 1..n {
            let at = from + i * stride;
            let (done, z) = z.split_at_mut(i);
            match done {
                [.., two, one] => take(z[0], &mask, |z, _| z, [(one, &first[at..]), (two, &second[at..])]),
                [.., one] => take(z[0], &mask, |z, _| z, [(one, &first[at..])]),
                [] => {}
            }
        }
        for i in (0..n).rev() {
            let at = from + i * stride;
            let (z, after) = z[i..].split_first_mut().expect("there is the value itself");
            let inverse = &lines.inverse[at..][..z.len()];
            let own = |z: f32, i: usize| z * (1.0 + mask[i] * (inverse[i] - 1.0));
            let (one, two) = (at + stride, at + 2 * stride);
            match after {
                [] => take(z, &mask, own, []),
                [next] => take(z, &mask, own, [(next, &first[one..])]),
                [next, last, ..] => take(z, &mask, own, [(next, &first[one..]), (last, &second[two..])]),
            }
        }
    }
}

/// Writes to `z` what `own` makes of value and index, less products of others' values and factors where `mask` is 1.
#[inline(always)]
fn take<const N: usize>(
    z: &mut [f32],
    mask: &[f32],
    own: impl Fn(f32, usize) -> f32,
    others: [(&&mut [f32], &[f32]); N],
) {
    let n = z.len();
    let (mask, others) = (&mask[..n], others.map(|(x, l)| (&x[..n], &l[..n])));
    for i in 0..n {
        let sum: f32 = others.iter().map(|(x, l)| x[i] * l[i]).sum();
        z[i] = own(z[i], i) - mask[i] * sum;
    }
}
