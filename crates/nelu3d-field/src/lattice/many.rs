//! Splines of any number of channels, at points side by side: the nodes along w of all channels are one row of numbers,
//! which is summed part by part. Inlined into functions that are dispatched.

use pulp::Simd;

use super::lanes::{Lanes, mul_add};

/// Points whose sums are stored before they are read again: what was just written as one vector cannot be read as
/// another one without waiting.
pub(crate) const GROUP: usize = 4;

/// Channels that a vector loop takes at a time.
const CHANNELS: usize = 8;

/// Returns the room for `k` channels, as [`sum_over_w`] writes them.
pub(crate) fn room(k: usize) -> usize {
    k.next_multiple_of(CHANNELS)
}

/// Sums of the nodes around some points over (a, b), M of them a point, each with its weights.
#[derive(Default)]
pub(crate) struct Sums<const M: usize> {
    k: usize,
    /// `[point][sum][node along w][channel]`, with room behind each sum for reading vectors from its last channel on.
    values: Vec<f32>,
}

impl<const M: usize> Sums<M> {
    /// Makes room for [`GROUP`] points of `k` channels, four or more.
    pub(crate) fn resize(&mut self, k: usize) {
        assert!(k >= 4, "rows of at least 16 numbers");
        self.k = k;
        self.values.resize(GROUP * M * (4 * k + CHANNELS), 0.0);
    }

    /// Computes the sums of point `l`, whose first node is at `first`, for place `at` of the group; weights are
    /// `[4 j + i]`.
    #[inline(always)]
    pub(crate) fn set<S: Simd>(
        &mut self,
        at: usize,
        nodes: &[f32],
        first: usize,
        offsets: &[usize; 16],
        weights: &[[Lanes; 16]; M],
        l: usize,
    ) {
        let (len, stride) = (4 * self.k, 4 * self.k + CHANNELS);
        let out = &mut self.values[at * M * stride..(at + 1) * M * stride];
        let mut begin = 0;
        while begin < len {
            // Parts of at most twelve vectors of sums; the last ones begin before the end of those before them.
            let rest = len - begin;
            if M == 1 && rest >= 32 {
                part::<S, 32, M>(nodes, first, offsets, weights, l, begin, out);
                begin += 32;
            } else if rest > 8 {
                let from = begin.min(len - 16);
                part::<S, 16, M>(nodes, first, offsets, weights, l, from, out);
                begin = from + 16;
            } else {
                part::<S, 8, M>(nodes, first, offsets, weights, l, len - 8, out);
                begin = len;
            }
        }
    }

    /// Returns sum `m` of the point at place `at`, to be read by [`sum_over_w`].
    #[inline(always)]
    pub(crate) fn get(&self, at: usize, m: usize) -> &[f32] {
        let stride = 4 * self.k + CHANNELS;
        &self.values[(at * M + m) * stride..(at * M + m + 1) * stride]
    }
}

/// Computes N consecutive numbers of every sum, from `begin` on.
#[inline(always)]
fn part<S: Simd, const N: usize, const M: usize>(
    nodes: &[f32],
    first: usize,
    offsets: &[usize; 16],
    weights: &[[Lanes; 16]; M],
    l: usize,
    begin: usize,
    out: &mut [f32],
) {
    let last = nodes.len().saturating_sub(N);
    let mut sums = [[0.0f32; N]; M];
    for n in 0..16 {
        // No part begins behind this, which the compiler then knows, too.
        let at = (first + offsets[n] + begin).min(last);
        let row: &[f32; N] = nodes[at..at + N].first_chunk().expect("a part of a row");
        for m in 0..M {
            let weight = weights[m][n][l];
            for i in 0..N {
                sums[m][i] = mul_add::<S>(weight, row[i], sums[m][i]);
            }
        }
    }
    let stride = out.len() / M;
    for m in 0..M {
        *out[m * stride + begin..].first_chunk_mut::<N>().expect("room for every part") = sums[m];
    }
}

/// Writes Σ over terms of weights × sums over the four nodes along w: `k` channels, and some numbers behind them up to
/// [`room`].
#[inline(always)]
pub(crate) fn sum_over_w<S: Simd, const T: usize>(k: usize, terms: [(&[f32], [f32; 4]); T], out: &mut [f32]) {
    for c in (0..k).step_by(CHANNELS) {
        let mut sum = [0.0f32; CHANNELS];
        for (sums, weights) in &terms {
            for (node, weight) in weights.iter().enumerate() {
                let from: &[f32; CHANNELS] = sums[node * k + c..].first_chunk().expect("room behind the sums");
                for i in 0..CHANNELS {
                    sum[i] = mul_add::<S>(*weight, from[i], sum[i]);
                }
            }
        }
        *out[c..].first_chunk_mut::<CHANNELS>().expect("room for whole vectors") = sum;
    }
}
