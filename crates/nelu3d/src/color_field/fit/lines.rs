//! A preconditioner that solves for whole lines of coefficients.
//!
//! Most codes are stripes: along them a codeword does not change, nor does it along the light's rays, and the penalty
//! there is thousands of times what samples weigh. Conjugate gradients with a diagonal preconditioner take steps of one
//! node along such lines; of the smoothness that predicts best they then show but a part. Here every channel's equations
//! along its smoother axis across are solved exactly, mode by mode along w, all else by its diagonal.
//!
//! In the camera's frame codewords change along all axes, and samples tell coefficients along w apart, in every column
//! others. The diagonal alone does better there: with lines and modes the demo's boards are predicted by 28 instead of 36
//! dB.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::modes::Modes;
use super::penalty::stencil;
use super::smoothness::Smoothness;

/// Values of a row of nodes whose lines along b are solved together: with their factors they stay in the second cache.
const WIDTH: usize = 1 << 8;
/// Values that are worked on together where each is by itself.
const BLOCK: usize = 1 << 14;
/// What every node of a line is held by, as a part of the penalty along it. Where samples tell nothing, a line is free to
/// move and turn, and what comes of it is rounding, which grows with the third power of the line's length.
const HOLD: f32 = 1e-6;

/// A matrix for every channel and every mode along w: the normal equations' diagonal and, along the axis across of more
/// smoothness, the whole penalty on second differences, pentadiagonal; as its factors L D Lᵀ. In the camera's frame, the
/// diagonal.
pub struct Lines {
    /// None in the camera's frame.
    modes: Option<Modes>,
    /// Values per row of nodes, and per column in it.
    row: usize,
    column: usize,
    /// Value by value of a column, `[mode][channel]`: 1 where lines run along b, 0 where along a.
    along_b: Vec<f32>,
    /// The penalty along the line of every value of a column.
    strengths: Vec<f32>,
    /// One over D, `[b][a][mode][channel]`. L follows from it and the penalty.
    inverse: Vec<f32>,
}

impl Lines {
    /// Factors the matrices. `diag` is the samples' part of the normal equations' diagonal, `[b][a][w][channel]`,
    /// `lambda` the unit of the penalties, channel by channel.
    pub fn new([na, nb, nw]: [usize; 3], mut diag: Vec<f32>, smooth: &Smoothness, lambda: &[f32]) -> Self {
        let k = lambda.len();
        let (column, row) = (nw * k, na * nw * k);
        debug_assert_eq!(diag.len(), nb * row);
        if smooth.slope_along == 0.0 {
            return Self::diagonal(column, diag, smooth, lambda);
        }
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

        let of_axis = |axis: f32| -> Vec<f32> {
            strengths.iter().zip(&along_b).map(|(s, b)| if *b == axis { *s } else { 0.0 }).collect()
        };
        if along_b.contains(&0.0) {
            let strengths = of_axis(0.0);
            diag.par_chunks_mut(row).for_each(|d| {
                let d = d.chunks_mut(column).collect();
                Arch::new().dispatch(Factor { d, strengths: &strengths });
            });
        }
        if along_b.contains(&1.0) {
            let strengths = of_axis(1.0).repeat(na);
            let blocks = in_blocks(&mut diag, row).into_par_iter().zip(strengths.par_chunks(WIDTH));
            blocks.for_each(|(d, strengths)| Arch::new().dispatch(Factor { d, strengths }));
        }
        diag.par_iter_mut().for_each(|d| *d = 1.0 / *d);
        Self { modes: Some(modes), row, column, along_b, strengths, inverse: diag }
    }

    /// The diagonal alone, of columns of so many values.
    fn diagonal(column: usize, mut diag: Vec<f32>, smooth: &Smoothness, lambda: &[f32]) -> Self {
        let along = 6.0 * smooth.along;
        let of_channel = |([a, b, w], l): (&[f32; 3], &f32)| l * (6.0 * smooth.across * (a + b) + along * w + 1e-6);
        let penalties: Vec<f32> = smooth.of_channels.iter().zip(lambda).map(of_channel).collect();
        let penalties = penalties.repeat(column / lambda.len());
        diag.par_chunks_mut(column).for_each(|d| d.iter_mut().zip(&penalties).for_each(|(d, p)| *d = 1.0 / (*d + p)));
        Self { modes: None, row: column, column, along_b: Vec::new(), strengths: Vec::new(), inverse: diag }
    }

    /// Writes M⁻¹ r to `z`, with M the matrices.
    pub fn solve(&self, r: &[f32], z: &mut [f32]) {
        let (row, column) = (self.row, self.column);
        let Some(modes) = &self.modes else {
            let rows = z.par_chunks_mut(BLOCK).zip(r.par_chunks(BLOCK).zip(self.inverse.par_chunks(BLOCK)));
            return rows.for_each(|(z, (r, i))| z.iter_mut().zip(r.iter().zip(i)).for_each(|(z, (r, i))| *z = r * i));
        };
        let arch = Arch::new();
        z.par_chunks_mut(row).zip(r.par_chunks(row)).for_each(|(y, x)| {
            arch.dispatch(Turn { modes, x, y, is_back: false });
        });
        if self.along_b.contains(&1.0) {
            in_blocks(z, row).into_par_iter().enumerate().for_each_init(Vec::new, |first, (block, z)| {
                let from = block * WIDTH;
                let of = |f: &dyn Fn(usize) -> f32| (from..from + z[0].len()).map(|i| f(i % column)).collect();
                let (mask, strengths) = (of(&|i| self.along_b[i]), of(&|i| self.along_b[i] * self.strengths[i]));
                arch.dispatch(Solve { inverse: &self.inverse[from..], stride: row, mask, strengths, z, first });
            });
        }
        let mask: Vec<f32> = self.along_b.iter().map(|b| 1.0 - b).collect();
        let strengths: Vec<f32> = mask.iter().zip(&self.strengths).map(|(m, s)| m * s).collect();
        let rows = z.par_chunks_mut(row).zip(self.inverse.par_chunks(row));
        rows.for_each_init(Default::default, |(first, turned): &mut (Vec<f32>, Vec<f32>), (z, inverse)| {
            if mask.contains(&1.0) {
                let (mask, strengths, z) = (mask.clone(), strengths.clone(), z.chunks_mut(column).collect());
                arch.dispatch(Solve { inverse, stride: column, mask, strengths, z, first });
            }
            turned.clear();
            turned.extend_from_slice(z);
            arch.dispatch(Turn { modes, x: turned, y: z, is_back: true });
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

/// D of lines side by side, node after node.
struct Factor<'a> {
    /// The matrix's diagonal without the penalty along the lines, `[node][value]`; becomes D.
    d: Vec<&'a mut [f32]>,
    /// The penalty's strength, value by value; 0 for what has no line here, and stays.
    strengths: &'a [f32],
}

impl WithSimd for Factor<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { mut d, strengths } = self;
        let n = d.len();
        // The recursion goes in double precision: its errors grow along a line as those of what it solves do.
        let mut before = vec![Before { d: [1.0; 2], first: 0.0 }; strengths.len()];
        for (d, penalty) in d.iter_mut().zip(stencil(n, 1.0)) {
            let [two, one, own, ..] = penalty.map(f64::from);
            for ((d, before), s) in d.iter_mut().zip(&mut before).zip(strengths) {
                let (Before { d: [d1, d2], first }, s) = (*before, f64::from(*s));
                let second = s * two / d2;
                let first = s * (one - two * first) / d1;
                // Without rounding D is never less than what the penalty is added to.
                let with = (f64::from(*d) + s * own - first * first * d1 - second * second * d2).max(f64::from(*d));
                *before = Before { d: [with, d1], first };
                *d = if s > 0.0 { with as f32 } else { *d };
            }
        }
    }
}

/// What D of a value follows from: that of the one before it on its line and of the one before that, and what the former
/// takes of the latter.
#[derive(Clone, Copy)]
struct Before {
    d: [f64; 2],
    first: f64,
}

/// The solution of lines side by side.
struct Solve<'a> {
    /// One over D, of the lines' first values and on.
    inverse: &'a [f32],
    /// How far the lines' next values are.
    stride: usize,
    /// Value by value: 1 where there is a line here, 0 where the value stays.
    mask: Vec<f32>,
    /// The penalty along it, 0 where it has no line here.
    strengths: Vec<f32>,
    /// The right side, `[node][value]`; becomes the solution.
    z: Vec<&'a mut [f32]>,
    /// Where to keep what values take of the ones before them.
    first: &'a mut Vec<f32>,
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { inverse, stride, mask, strengths, mut z, first } = self;
        let (n, width) = (z.len(), mask.len());
        let strengths = &strengths[..width];
        let inverse = |i: usize| part(inverse, i * stride, width);
        first.clear();
        first.resize(n * width, 0.0);
        for (i, penalty) in stencil(n, 1.0).into_iter().enumerate().skip(1) {
            let [two, one, ..] = penalty;
            let ((done, z), (l_done, l)) = (z.split_at_mut(i), first.split_at_mut(i * width));
            let (z, z1) = (&mut z[0][..width], &done[i - 1][..width]);
            let (l, l1) = (&mut l[..width], &l_done[(i - 1) * width..][..width]);
            let inverse1 = inverse(i - 1);
            for j in 0..width {
                l[j] = strengths[j] * (one - two * l1[j]) * inverse1[j];
                z[j] -= l[j] * z1[j];
            }
            if let Some(i2) = i.checked_sub(2) {
                let (z2, inverse2) = (&done[i2][..width], inverse(i2));
                (0..width).for_each(|j| z[j] -= strengths[j] * inverse2[j] * z2[j]);
            }
        }
        for i in (0..n).rev() {
            let (z, after) = z[i..].split_first_mut().expect("there is the value itself");
            let (z, inverse) = (&mut z[..width], inverse(i));
            (0..width).for_each(|j| z[j] *= 1.0 + mask[j] * (inverse[j] - 1.0));
            if let [z1, ..] = after {
                let (z1, l) = (&z1[..width], part(first, (i + 1) * width, width));
                (0..width).for_each(|j| z[j] -= l[j] * z1[j]);
            }
            if let [_, z2, ..] = after {
                let z2 = &z2[..width];
                (0..width).for_each(|j| z[j] -= strengths[j] * inverse[j] * z2[j]);
            }
        }
    }
}

/// Returns so many values from `at` on.
#[inline(always)]
fn part(values: &[f32], at: usize, width: usize) -> &[f32] {
    &values[at..][..width]
}
