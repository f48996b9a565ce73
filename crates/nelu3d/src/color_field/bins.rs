//! The samples of a sweep, averaged in small bins, to which every form of the field is fitted.

use std::ops::Range;

use rayon::prelude::*;

/// Samples of the field gathered in small bins: memory depends on the volume and its resolution, not on how many board
/// positions there were. A bin keeps the weighted mean of its samples' coordinates and values, and how widely they are
/// spread across, so it acts as one sample at their centroid that sees as far around it: from many positions a bin's
/// mean is a blurred value, and a field fitted to it as a point's would be blurred, too.
pub struct Bins {
    /// Number of bins along a, b and w.
    counts: [usize; 3],
    /// Pattern channels.
    k: usize,
    /// Per bin `[b][w][a]`, so that samples along a row of one board are side by side: Σω̄, Σω̄ q (3, relative to the
    /// bin's center, in bins), Σω̄ a² and Σω̄ b² (the same), Σω (k), Σω L (k).
    pub sums: Vec<f32>,
}

/// The sample that a filled bin stands for, at the centroid of its samples.
#[derive(Clone, Copy)]
pub struct Sample<'a> {
    /// Unit coordinates.
    pub q: [f32; 3],
    /// Variances of its samples along a and b, in squared bins.
    pub spread: [f32; 2],
    /// Σω̄, where ω̄ is the mean weight over channels.
    pub(crate) mean: f32,
    /// Σω per channel.
    pub omegas: &'a [f32],
    /// Σω L per channel.
    pub moments: &'a [f32],
}

/// Sums per bin ahead of those of the channels.
const AHEAD: usize = 6;
/// Number of rows of bins that are filled together.
const STRIPE: usize = 16;

/// Samples that were collected for [`Bins`], sorted by rows of bins so that these can be filled in parallel.
#[derive(Clone)]
pub struct Gathered {
    /// Number of rows of bins.
    rows: usize,
    /// Pattern channels.
    k: usize,
    /// Per stripe of rows and sample: coordinates, values, weights.
    stripes: Vec<Vec<f32>>,
}

impl Gathered {
    /// Adds a sample, as [`Bins::add`] would.
    #[inline]
    pub fn push(&mut self, q: [f32; 3], values: &[f32], omegas: &[f32]) {
        assert!(values.len() == self.k && omegas.len() == self.k);
        let row = ((q[1] * self.rows as f32) as i32).clamp(0, self.rows as i32 - 1) as usize;
        let stripe = &mut self.stripes[row / STRIPE];
        stripe.extend_from_slice(&q);
        stripe.extend_from_slice(values);
        stripe.extend_from_slice(omegas);
    }

    /// Returns the samples at unit coordinates for which `is_kept` holds.
    pub(crate) fn kept(&self, is_kept: impl Fn([f32; 3]) -> bool) -> Self {
        let size = 3 + 2 * self.k;
        let of_stripe = |stripe: &Vec<f32>| {
            let records = stripe.chunks_exact(size).filter(|record| is_kept([record[0], record[1], record[2]]));
            records.flatten().copied().collect()
        };
        Self { stripes: self.stripes.iter().map(of_stripe).collect(), ..*self }
    }

    /// Calls `f(q, values, weights)` for every sample.
    pub(crate) fn for_each(&self, mut f: impl FnMut([f32; 3], &[f32], &[f32])) {
        for record in self.stripes.iter().flat_map(|s| s.chunks_exact(3 + 2 * self.k)) {
            let (q, rest) = record.split_at(3);
            let (values, omegas) = rest.split_at(self.k);
            f([q[0], q[1], q[2]], values, omegas);
        }
    }
}

/// Returns `n` zeros that have been written. Memory that was only asked for is mapped when it is read, and again, with
/// word to every core, when it is written: to add to it costs more than to have filled it.
pub(super) fn written_zeros(n: usize) -> Vec<f32> {
    const AT_A_TIME: usize = 1 << 16;
    (0..n).into_par_iter().with_min_len(AT_A_TIME).map(|_| 0.0).collect()
}

impl Bins {
    /// Makes empty bins over the unit cube, `counts` along a, b and w.
    pub fn new(counts: [usize; 3], k: usize) -> Self {
        Self { counts, k, sums: written_zeros(counts.iter().product::<usize>() * (AHEAD + 2 * k)) }
    }

    /// Returns the number of pattern channels.
    pub(crate) fn k(&self) -> usize {
        self.k
    }

    /// Returns the number of bins along a, b and w.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Returns the number of bins along b.
    pub fn n_rows(&self) -> usize {
        self.counts[1]
    }

    /// Returns the number of sums per bin.
    fn stride(&self) -> usize {
        AHEAD + 2 * self.k
    }

    /// Returns the number of sums per row of bins.
    fn per_row(&self) -> usize {
        self.counts[0] * self.counts[2] * self.stride()
    }

    /// Adds one sample: unit coordinates, k values, k weights (0 = that channel is missing).
    pub fn add(&mut self, q: [f32; 3], values: &[f32], omegas: &[f32]) {
        add(&mut self.sums, self.counts, 0, q, values, omegas);
    }

    /// Returns an empty collection of samples for these bins.
    pub fn gathered(&self) -> Gathered {
        Gathered { rows: self.counts[1], k: self.k, stripes: vec![Vec::new(); self.counts[1].div_ceil(STRIPE)] }
    }

    /// Adds collections made by [`Self::gathered`]: rows of bins in parallel, each bin's samples in order.
    pub fn add_all(&mut self, parts: &[Gathered]) {
        self.for_each_gathered(parts, add);
    }

    /// Takes collections out again that [`Self::add_all`] added.
    pub fn remove_all(&mut self, parts: &[Gathered]) {
        self.for_each_gathered(parts, remove);
    }

    /// Calls `f(sums, counts, first row, q, values, weights)` for every sample of collections, with the sums of its
    /// stripe.
    #[inline(always)]
    fn for_each_gathered(
        &mut self,
        parts: &[Gathered],
        f: impl Fn(&mut [f32], [usize; 3], usize, [f32; 3], &[f32], &[f32]) + Sync,
    ) {
        let (counts, k) = (self.counts, self.k);
        let per_stripe = self.per_row() * STRIPE;
        self.sums.par_chunks_mut(per_stripe).enumerate().for_each(|(stripe, sums)| {
            for part in parts {
                for record in part.stripes[stripe].chunks_exact(3 + 2 * k) {
                    let (q, rest) = record.split_at(3);
                    let (values, omegas) = rest.split_at(k);
                    f(sums, counts, stripe * STRIPE, [q[0], q[1], q[2]], values, omegas);
                }
            }
        });
    }

    /// Calls `f` for the filled bins of row `b`, in order.
    #[inline(always)]
    pub fn for_each_in_row(&self, b: usize, mut f: impl FnMut(Sample<'_>)) {
        let row = &self.sums[b * self.per_row()..(b + 1) * self.per_row()];
        let step = self.counts.map(|n| 1.0 / n as f32);
        let [na, _, nw] = self.counts;
        for a in 0..na {
            for w in 0..nw {
                let bin = &row[(w * na + a) * self.stride()..][..self.stride()];
                if bin[0] > 0.0 {
                    let cell = [a, b, w];
                    let norm = 1.0 / bin[0];
                    let mut q = [0.0; 3];
                    for i in 0..3 {
                        q[i] = (cell[i] as f32 + 0.5 + bin[1 + i] * norm) * step[i];
                    }
                    let spread = [0, 1].map(|i| {
                        let offset = bin[1 + i] * norm;
                        (bin[4 + i] * norm - offset * offset).clamp(0.0, 0.25)
                    });
                    let (omegas, moments) = bin[AHEAD..].split_at(self.k);
                    f(Sample { q, spread, mean: bin[0], omegas, moments });
                }
            }
        }
    }

    /// Calls `f(q, values, weights)` for every sample that the bins stand for.
    pub fn for_each_sample(&self, mut f: impl FnMut([f32; 3], &[f32], &[f32])) {
        let mut values = vec![0.0; self.k];
        for b in 0..self.n_rows() {
            self.for_each_in_row(b, |s| {
                for c in 0..self.k {
                    values[c] = if s.omegas[c] > 0.0 { s.moments[c] / s.omegas[c] } else { 0.0 };
                }
                f(s.q, &values, s.omegas);
            });
        }
    }

    /// Returns the bins of some columns and rows alone, whose unit cube is as large as they are.
    pub(crate) fn window(&self, [along_a, along_b]: &[Range<usize>; 2]) -> Self {
        let [na, _, nw] = self.counts;
        let of_line = |line: usize| &self.sums[line * na * self.stride()..];
        let of_window = |line| &of_line(line)[along_a.start * self.stride()..along_a.end * self.stride()];
        let sums = (along_b.start * nw..along_b.end * nw).flat_map(of_window).copied().collect();
        Self { counts: [along_a.len(), along_b.len(), self.counts[2]], k: self.k, sums }
    }

    /// Returns the same samples in fewer, larger bins.
    pub fn merged(&self, counts: [usize; 3]) -> Self {
        let mut out = Self::new(counts, self.k);
        let per_row = out.per_row();
        let stride = out.stride();
        out.sums.par_chunks_mut(per_row).enumerate().for_each(|(row, sums)| {
            // The rows of bins that may hold samples of this one: one more on either side than geometry says.
            let ratio = self.counts[1] as f64 / counts[1] as f64;
            let first = ((row as f64 * ratio) as usize).saturating_sub(1);
            let last = (((row + 1) as f64 * ratio) as usize + 2).min(self.counts[1]);
            let mut add = |s: Sample<'_>| {
                let Some(cell) = cell_of(counts, s.q).filter(|c| c[1] == row) else { return };
                let bin = &mut sums[(cell[2] * counts[0] + cell[0]) * stride..][..stride];
                add_weight(bin, counts, cell, s.q, s.mean);
                for i in 0..2 {
                    bin[4 + i] += s.mean * s.spread[i] * (counts[i] as f32 / self.counts[i] as f32).powi(2);
                }
                let (w, wv) = bin[AHEAD..].split_at_mut(self.k);
                w.iter_mut().zip(s.omegas).for_each(|(to, from)| *to += from);
                wv.iter_mut().zip(s.moments).for_each(|(to, from)| *to += from);
            };
            (first..last).for_each(|b| self.for_each_in_row(b, &mut add));
        });
        out
    }
}

/// Adds a sample to the bins of the rows from `first` on.
#[inline(always)]
fn add(sums: &mut [f32], counts: [usize; 3], first: usize, q: [f32; 3], values: &[f32], omegas: &[f32]) {
    let Some((bin, cell, mean)) = bin_of(sums, counts, first, q, omegas) else { return };
    add_weight(bin, counts, cell, q, mean);
    let (w, wv) = bin[AHEAD..].split_at_mut(values.len());
    for j in 0..values.len() {
        w[j] += omegas[j];
        wv[j] += omegas[j] * values[j];
    }
}

/// Takes a sample out again that [`add`] has added.
fn remove(sums: &mut [f32], counts: [usize; 3], first: usize, q: [f32; 3], values: &[f32], omegas: &[f32]) {
    let Some((bin, cell, mean)) = bin_of(sums, counts, first, q, omegas) else { return };
    add_weight(bin, counts, cell, q, -mean);
    // Rounding leaves a remainder of the last sample.
    if bin[0] < 1e-4 * mean {
        bin.fill(0.0);
        return;
    }
    let (w, wv) = bin[AHEAD..].split_at_mut(values.len());
    for j in 0..values.len() {
        w[j] = (w[j] - omegas[j]).max(0.0);
        wv[j] -= omegas[j] * values[j];
    }
}

/// Returns the sums of the bin that a sample at `q` belongs to, in rows from `first` on, its cell, and the sample's
/// mean weight; `None` outside the unit cube and for a sample without weight.
#[inline(always)]
fn bin_of<'a>(
    sums: &'a mut [f32],
    counts: [usize; 3],
    first: usize,
    q: [f32; 3],
    omegas: &[f32],
) -> Option<(&'a mut [f32], [usize; 3], f32)> {
    let cell = cell_of(counts, q)?;
    let k = omegas.len();
    let mean = omegas.iter().sum::<f32>() / k as f32;
    let stride = AHEAD + 2 * k;
    let at = (((cell[1] - first) * counts[2] + cell[2]) * counts[0] + cell[0]) * stride;
    (mean > 0.0).then(|| (&mut sums[at..at + stride], cell, mean))
}

/// Returns the bin of a point; `None` outside the unit cube.
#[inline(always)]
fn cell_of(counts: [usize; 3], q: [f32; 3]) -> Option<[usize; 3]> {
    let inside = q.iter().all(|q| (0.0..=1.0).contains(q));
    inside.then(|| std::array::from_fn(|i| ((q[i] * counts[i] as f32) as i32 as usize).min(counts[i] - 1)))
}

/// Adds a weight and its position to a bin.
#[inline(always)]
fn add_weight(bin: &mut [f32], counts: [usize; 3], cell: [usize; 3], q: [f32; 3], mean: f32) {
    // Coordinates relative to the bin's center: a float sum of hundreds of nearly equal numbers would lose them.
    bin[0] += mean;
    for i in 0..3 {
        let offset = q[i] * counts[i] as f32 - cell[i] as f32 - 0.5;
        bin[1 + i] += mean * offset;
        if i < 2 {
            bin[4 + i] += mean * offset * offset;
        }
    }
}
