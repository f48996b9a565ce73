//! The fast form: 16 samples at a time, in vectors.

use pulp::{Arch, Simd, WithSimd};

use super::{NodeStrides, Place, Weights};
use crate::lattice::lanes::{LANES, Lanes, mul_add, slopes_of, weights_of};

/// Samples of a cell that are added to its nodes together.
const TOGETHER: usize = 2;
/// Room behind the numbers of a sample, for reading and writing whole vectors from its last channel on.
const ROOM: usize = 8;

/// Does `$call` with the beginning and the length `$N` of every part of a run of `$len` numbers, a multiple of four.
macro_rules! by_parts {
    ($len:expr, $begin:ident, $N:ident => $call:expr) => {
        let mut $begin = 0;
        while $begin + 32 <= $len {
            const $N: usize = 32;
            $call;
            $begin += $N;
        }
        if $begin + 16 <= $len {
            const $N: usize = 16;
            $call;
            $begin += $N;
        }
        if $begin + 8 <= $len {
            const $N: usize = 8;
            $call;
            $begin += $N;
        }
        if $begin < $len {
            const $N: usize = 4;
            $call;
        }
    };
}

/// Adds Bᵀ Ω B x to y. `omegas` are the weights, `[sample][channel]`; x and y hold nodes from the same one on. Sums of
/// samples are taken in their order.
///
/// # Panics
///
/// If a length does not fit.
pub fn add_product(strides: NodeStrides, places: &[Place], omegas: &[f32], x: &[f32], y: &mut [f32]) {
    strides.check(places, omegas);
    dispatch(Samples { strides, places, values: omegas, x: Some(x), by: Weights::Plain, y });
}

/// Adds values of samples, `[sample][channel]`, to their nodes: Bᵀ v, or with squared weights.
///
/// # Panics
///
/// If a length does not fit.
pub fn add_spread(strides: NodeStrides, places: &[Place], values: &[f32], by: Weights, y: &mut [f32]) {
    strides.check(places, values);
    dispatch(Samples { strides, places, values, x: None, by, y });
}

/// Runs the loops that are compiled for the number of channels, if there are any.
fn dispatch(samples: Samples<'_>) {
    if samples.places.is_empty() {
        return;
    }
    match samples.strides.k {
        1 => Arch::new().dispatch(OfChannels::<1, 4, 0, 4>(samples)),
        2 => Arch::new().dispatch(OfChannels::<2, 8, 0, 4>(samples)),
        3 => Arch::new().dispatch(OfChannels::<3, 8, 4, 4>(samples)),
        4 => Arch::new().dispatch(OfChannels::<4, 16, 0, 4>(samples)),
        5 => Arch::new().dispatch(OfChannels::<5, 16, 4, 8>(samples)),
        6 => Arch::new().dispatch(OfChannels::<6, 16, 8, 8>(samples)),
        _ => Arch::new().dispatch(OfChannels::<0, 0, 0, 8>(samples)),
    }
}

struct Samples<'a> {
    strides: NodeStrides,
    places: &'a [Place],
    /// Weights with x, else values, `[sample][channel]`.
    values: &'a [f32],
    x: Option<&'a [f32]>,
    by: Weights,
    y: &'a mut [f32],
}

/// Samples of K channels, whose runs are vectors of N and M numbers together; 0 for any number. W channels are taken at
/// a time.
struct OfChannels<'a, const K: usize, const N: usize, const M: usize, const W: usize>(Samples<'a>);

/// Weights of samples side by side.
struct SomeWeights {
    /// Of the 16 runs, `[4 b + a]`.
    across: [Lanes; 16],
    /// Of the nodes of a run.
    along: [Lanes; 4],
}

impl<const K: usize, const N: usize, const M: usize, const W: usize> WithSimd for OfChannels<'_, K, N, M, W> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Samples { strides, places, values, x, by, y } = self.0;
        let k = if K > 0 { K } else { strides.k };
        let (len, stride) = (4 * k, 4 * k + ROOM);
        let mut offsets = [0; 16];
        for n in 0..16 {
            offsets[n] = n / 4 * strides.row + n % 4 * strides.column;
        }
        let mut runs = vec![0.0f32; LANES * stride];
        let mut own = vec![0.0f32; LANES * k + ROOM];
        let mut weighed = vec![0.0f32; LANES * (k + ROOM)];
        for (places, values) in places.chunks(LANES).zip(values.chunks(LANES * k)) {
            let end = places.iter().map(|p| p.base as usize).max().unwrap_or(0) + strides.extent();
            assert!(end <= y.len() && x.is_none_or(|x| end <= x.len()), "every run lies in x and y");
            let mut weights = SomeWeights::of(places);
            // A copy with room behind it.
            own[..values.len()].copy_from_slice(values);
            // What was written is read as other vectors only when all samples have it.
            if let Some(x) = x {
                for (l, place) in places.iter().enumerate() {
                    let (base, run) = (place.base as usize, &mut runs[l * stride..][..len]);
                    if K > 0 {
                        gather::<S, N, M>(x, base, &offsets, &weights.across, l, run);
                    } else {
                        by_parts!(len, begin, P => {
                            gather::<S, P, 0>(x, base + begin, &offsets, &weights.across, l, &mut run[begin..]);
                        });
                    }
                }
                for l in 0..places.len() {
                    let run = &runs[l * stride..][..stride];
                    weigh::<S, W>(&own[l * k..], run, &weights.along, l, k, &mut weighed[l * (k + ROOM)..]);
                }
            }
            if by == Weights::Squared {
                weights.square();
            }
            for l in 0..places.len() {
                let values = if x.is_some() { &weighed[l * (k + ROOM)..] } else { &own[l * k..] };
                repeat::<W>(values, &weights.along, l, k, &mut runs[l * stride..][..stride]);
            }
            let mut l = 0;
            while l < places.len() {
                let (first, rest) = (&places[l], &places[l + 1..]);
                let together = rest.first().is_some_and(|next| next.base == first.base);
                let (base, across, runs) = (first.base as usize, &weights.across, &runs[l * stride..]);
                match (K > 0, together) {
                    (true, true) => spread::<S, TOGETHER, N, M>(y, base, &offsets, across, l, runs, stride),
                    (true, false) => spread::<S, 1, N, M>(y, base, &offsets, across, l, runs, stride),
                    (false, true) => {
                        by_parts!(len, begin, P => {
                            let (base, runs) = (base + begin, &runs[begin..]);
                            spread::<S, TOGETHER, P, 0>(y, base, &offsets, across, l, runs, stride);
                        });
                    }
                    (false, false) => {
                        by_parts!(len, begin, P => {
                            let (base, runs) = (base + begin, &runs[begin..]);
                            spread::<S, 1, P, 0>(y, base, &offsets, across, l, runs, stride);
                        });
                    }
                }
                l += if together { TOGETHER } else { 1 };
            }
        }
    }
}

impl SomeWeights {
    /// Returns the weights of at most [`LANES`] samples.
    #[inline(always)]
    fn of(places: &[Place]) -> Self {
        let (mut position, mut spread) = ([[0.0; LANES]; 3], [[0.0; LANES]; 2]);
        for (l, place) in places.iter().enumerate() {
            for i in 0..3 {
                position[i][l] = place.position[i];
            }
            for i in 0..2 {
                spread[i][l] = place.spread[i];
            }
        }
        // A mean over points: w + ½ v w″.
        let mut of_axes = [weights_of(&position[0]), weights_of(&position[1])];
        for i in 0..2 {
            let [_, bends] = slopes_of(&position[i]);
            for n in 0..4 {
                for l in 0..LANES {
                    of_axes[i][n][l] += 0.5 * spread[i][l] * bends[n][l];
                }
            }
        }
        let mut across = [[0.0; LANES]; 16];
        for n in 0..16 {
            for l in 0..LANES {
                across[n][l] = of_axes[1][n / 4][l] * of_axes[0][n % 4][l];
            }
        }
        Self { across, along: weights_of(&position[2]) }
    }

    #[inline(always)]
    fn square(&mut self) {
        for weights in self.across.iter_mut().chain(&mut self.along) {
            for l in 0..LANES {
                weights[l] *= weights[l];
            }
        }
    }
}

/// Computes N + M numbers of a run: Σ weight · run of x.
#[inline(always)]
fn gather<S: Simd, const N: usize, const M: usize>(
    x: &[f32],
    base: usize,
    offsets: &[usize; 16],
    across: &[Lanes; 16],
    l: usize,
    run: &mut [f32],
) {
    let last = x.len().saturating_sub(N + M);
    let (mut low, mut high) = ([0.0f32; N], [0.0f32; M]);
    for n in 0..16 {
        // No run begins behind this, which the compiler then knows, too.
        let at = (base + offsets[n]).min(last);
        let (x, weight) = (&x[at..at + N + M], across[n][l]);
        for i in 0..N {
            low[i] = mul_add::<S>(weight, x[i], low[i]);
        }
        for i in 0..M {
            high[i] = mul_add::<S>(weight, x[N + i], high[i]);
        }
    }
    run[..N].copy_from_slice(&low);
    run[N..N + M].copy_from_slice(&high);
}

/// Writes a sample's values: its weights times the sums over a run's nodes.
#[inline(always)]
fn weigh<S: Simd, const W: usize>(
    omegas: &[f32],
    run: &[f32],
    along: &[Lanes; 4],
    l: usize,
    k: usize,
    values: &mut [f32],
) {
    let weights = [along[0][l], along[1][l], along[2][l], along[3][l]];
    let mut c = 0;
    while c < k {
        let mut sum = [0.0f32; W];
        for n in 0..4 {
            let from: &[f32; W] = run[n * k + c..].first_chunk().expect("room behind a run");
            for i in 0..W {
                sum[i] = mul_add::<S>(weights[n], from[i], sum[i]);
            }
        }
        let omegas: &[f32; W] = omegas[c..].first_chunk().expect("room behind the weights");
        let values: &mut [f32; W] = values[c..].first_chunk_mut().expect("room behind the values");
        for i in 0..W {
            values[i] = omegas[i] * sum[i];
        }
        c += W;
    }
}

/// Writes a run: values times the weights of its nodes.
#[inline(always)]
fn repeat<const W: usize>(values: &[f32], along: &[Lanes; 4], l: usize, k: usize, run: &mut [f32]) {
    // Of what is written behind a node's channels, the next node's take the place.
    for n in 0..4 {
        let weight = along[n][l];
        let mut c = 0;
        while c < k {
            let from: &[f32; W] = values[c..].first_chunk().expect("room behind the values");
            let to: &mut [f32; W] = run[n * k + c..].first_chunk_mut().expect("room behind a run");
            for i in 0..W {
                to[i] = weight * from[i];
            }
            c += W;
        }
    }
}

/// Adds N + M numbers of the weighted runs of T samples of one cell, which are `stride` apart, to the runs of y.
#[inline(always)]
fn spread<S: Simd, const T: usize, const N: usize, const M: usize>(
    y: &mut [f32],
    base: usize,
    offsets: &[usize; 16],
    across: &[Lanes; 16],
    l: usize,
    runs: &[f32],
    stride: usize,
) {
    let (mut low, mut high) = ([[0.0f32; N]; T], [[0.0f32; M]; T]);
    for t in 0..T {
        let run = &runs[t * stride..][..N + M];
        low[t].copy_from_slice(&run[..N]);
        high[t].copy_from_slice(&run[N..]);
    }
    let last = y.len().saturating_sub(N + M);
    for n in 0..16 {
        let at = (base + offsets[n]).min(last);
        let y = &mut y[at..at + N + M];
        for t in 0..T {
            let weight = across[n][l + t];
            for i in 0..N {
                y[i] = mul_add::<S>(weight, low[t][i], y[i]);
            }
            for i in 0..M {
                y[N + i] = mul_add::<S>(weight, high[t][i], y[N + i]);
            }
        }
    }
}
