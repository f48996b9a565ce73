//! Ceilings of one core.

use super::{LINE, best_secs};
use crate::memory;
use crate::prefetch::prefetch;
use pulp::{Arch, Simd, WithSimd};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::hint::black_box;

/// Sizes of the tables read and written at random: first- and second-level cache, third level, main memory.
const TABLE_BYTES: [usize; 5] = [1 << 14, 1 << 18, 1 << 22, 1 << 25, 1 << 28];
/// Main memory for the bandwidth: larger than any cache.
const STREAM_BYTES: usize = 1 << 28;
/// Accesses between the one made and the one asked for.
const AHEAD: usize = 32;

/// Accesses per second in a table.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Rate {
    /// Bytes of the table.
    pub table_bytes: usize,
    /// Cache lines per second.
    pub lines_per_sec: f64,
}

/// The abilities of one core of this machine.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Machine {
    /// Vector instructions the kernels were dispatched to.
    pub simd: String,
    /// Fused multiply-adds in single precision, two operations each.
    pub flops_per_sec: f64,
    /// Reading and writing main memory in order (half of the bytes each way).
    pub bytes_per_sec: f64,
    /// Reading lines at random.
    pub reads: Vec<Rate>,
    /// Reading and writing lines at random.
    pub updates: Vec<Rate>,
    /// `f64::exp`.
    pub exponentials_per_sec: f64,
}

impl Machine {
    /// Measures for about `budget_secs` of processor time.
    pub fn measure(budget_secs: f64) -> Self {
        let part = budget_secs / 13.0;
        let n_flops = 1 << 20;
        let flops = best_secs(part, || {
            black_box(Arch::new().dispatch(Fma(n_flops)));
        });
        let mut stream = memory::zeros(STREAM_BYTES / 4);
        stream.fill(1.0);
        let bytes = best_secs(part, || Arch::new().dispatch(Stream(&mut stream)));
        let mut rng = StdRng::seed_from_u64(1);
        let mut rates = |update: bool| -> Vec<Rate> {
            let rate = |table_bytes: usize| {
                let n = (table_bytes / LINE).clamp(1 << 12, 1 << 18);
                let indices: Vec<u32> = (0..n).map(|_| rng.random_range(0..(table_bytes / LINE) as u32) * 8).collect();
                let table = stream[..table_bytes / 4].as_chunks_mut::<2>().0;
                let secs = best_secs(part, || {
                    if update {
                        Arch::new().dispatch(Updates(table, &indices));
                    } else {
                        black_box(Arch::new().dispatch(Reads(table, &indices)));
                    }
                });
                Rate { table_bytes, lines_per_sec: n as f64 / secs }
            };
            TABLE_BYTES.into_iter().map(rate).collect()
        };
        let (reads, updates) = (rates(false), rates(true));
        let exponents: Vec<f64> = (0..4096).map(|i| -(i as f64) * 1e-3).collect();
        let exponentials = best_secs(part, || {
            black_box(exponents.iter().map(|x| x.exp()).sum::<f64>());
        });
        Self {
            simd: simd_name(),
            flops_per_sec: Arch::new().dispatch(FlopsOf(n_flops)) / flops,
            bytes_per_sec: 2.0 * STREAM_BYTES as f64 / bytes,
            reads,
            updates,
            exponentials_per_sec: exponents.len() as f64 / exponentials,
        }
    }
}

/// Returns the lines per second in a table of `bytes`, given those in tables of some sizes, in ascending order and at
/// least one: linear over the logarithm of the size between them, and that of the nearest size beyond them.
pub fn interpolate(rates: &[Rate], bytes: usize) -> f64 {
    let after = rates.partition_point(|r| r.table_bytes < bytes);
    let (a, b) = (rates[after.saturating_sub(1)], rates[after.min(rates.len() - 1)]);
    if a.table_bytes == b.table_bytes {
        return b.lines_per_sec;
    }
    let log = |bytes: usize| (bytes as f64).ln();
    let t = (log(bytes) - log(a.table_bytes)) / (log(b.table_bytes) - log(a.table_bytes));
    a.lines_per_sec + t * (b.lines_per_sec - a.lines_per_sec)
}

fn simd_name() -> String {
    struct Name;
    impl WithSimd for Name {
        type Output = &'static str;
        fn with_simd<S: Simd>(self, _: S) -> &'static str {
            std::any::type_name::<S>()
        }
    }
    let name = Arch::new().dispatch(Name);
    name.rsplit("::").next().unwrap_or(name).to_lowercase()
}

/// Accumulators: enough to hide the latency of two units.
const N_SUMS: usize = 12;

/// Dependent chains of fused multiply-adds that never leave the registers.
struct Fma(usize);

impl WithSimd for Fma {
    type Output = f32;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let (a, b) = (simd.splat_f32s(black_box(0.999)), simd.splat_f32s(black_box(1e-3)));
        let mut sums = [simd.splat_f32s(1.0); N_SUMS];
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = simd.mul_add_e_f32s(*sum, a, b);
            }
        }
        sums.into_iter().map(|sum| simd.reduce_sum_f32s(sum)).sum()
    }
}

struct FlopsOf(usize);

impl WithSimd for FlopsOf {
    type Output = f64;
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        2.0 * (self.0 * N_SUMS * S::F32_LANES) as f64
    }
}

struct Stream<'a>(&'a mut [f32]);

impl WithSimd for Stream<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for x in self.0 {
            *x = *x * 0.5 + 1.0;
        }
    }
}

struct Reads<'a>(&'a [[f32; 2]], &'a [u32]);

impl WithSimd for Reads<'_> {
    type Output = f32;
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f32 {
        let Self(table, indices) = self;
        let mut sums = [0.0; 4];
        for (i, group) in indices.chunks_exact(4).enumerate() {
            for (lane, &index) in group.iter().enumerate() {
                if let Some(&later) = indices.get(4 * i + lane + AHEAD) {
                    prefetch(table, later as usize);
                }
                let [a, b] = table[index as usize];
                sums[lane] += a + b;
            }
        }
        sums.iter().sum()
    }
}

struct Updates<'a>(&'a mut [[f32; 2]], &'a [u32]);

impl WithSimd for Updates<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self(table, indices) = self;
        for (i, &index) in indices.iter().enumerate() {
            if let Some(&later) = indices.get(i + AHEAD) {
                prefetch(table, later as usize);
            }
            let [a, b] = &mut table[index as usize];
            *a += 1.0;
            *b -= 1.0;
        }
    }
}
