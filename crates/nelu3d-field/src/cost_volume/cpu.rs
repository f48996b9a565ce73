//! The fast form on the CPU: hypotheses in lanes, pixels in parallel, paths row by row, costs in 16 bits.

use super::aggregate::{Aggregation, CHUNK, MAX_PATH, NO_SLOT, OUTSIDE};
use super::costs::{Costs, PixelScratch};
use super::problem::{self, NEAR, Problem, Winner};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Pixels that one task takes at a time.
const PIXELS: usize = 64;

/// Returns the winner of every pixel; see [`super::winners`].
pub(super) fn winners(problem: &Problem<'_>) -> Vec<Winner> {
    let stride = problem.hypotheses.count.next_multiple_of(CHUNK);
    // No path costs more than its last pixel and a jump.
    let scale = MAX_PATH / (problem.saturation + problem.jump);
    // Memory that is only asked for is mapped by the tasks that write it.
    let mut costs = vec![0u16; problem.pixels.len() * stride];
    let slots = compute_costs(problem, scale, stride, &mut costs);
    let stored = |cost: f32| (cost * scale).round() as u16;
    let aggregation = Aggregation {
        width: problem.width,
        height: problem.height,
        pixels: problem.pixels,
        slots: &slots,
        stride,
        costs: &costs,
        step: stored(problem.step),
        jump: stored(problem.jump),
    };
    let [first, second] = aggregation.sums();
    let mut out = vec![Winner::NONE; problem.pixels.len()];
    let rows = first.par_chunks(PIXELS * stride).zip(second.par_chunks(PIXELS * stride));
    rows.zip(costs.par_chunks(PIXELS * stride)).zip(out.par_chunks_mut(PIXELS)).for_each(
        |(((first, second), costs), out)| {
            let sums = [first, second];
            Arch::new().dispatch(SomeWinners { sums, costs, stride, count: problem.hypotheses.count, scale, out });
        },
    );
    // To give a volume back takes as long as to map it.
    rayon::join(|| drop(first), || rayon::join(|| drop(second), || drop(costs)));
    out
}

/// Writes the costs `[slot][hypothesis]` in units of 1 / `scale`; returns the slot of every pixel of the image that a
/// path passes.
fn compute_costs(problem: &Problem<'_>, scale: f32, stride: usize, costs: &mut [u16]) -> Vec<u32> {
    let mut is_inside = vec![false; problem.pixels.len()];
    costs
        .par_chunks_mut(PIXELS * stride)
        .zip(is_inside.par_chunks_mut(PIXELS))
        .zip(problem.pixels.par_chunks(PIXELS))
        .for_each_init(PixelScratch::default, |scratch, ((costs, is_inside), pixels)| {
            Arch::new().dispatch(SomePixels { problem, scale, stride, pixels, costs, is_inside, scratch });
        });
    let mut slots = vec![NO_SLOT; problem.width * problem.height];
    for ((slot, pixel), is_inside) in problem.pixels.iter().enumerate().zip(is_inside) {
        if is_inside {
            slots[*pixel as usize] = slot as u32;
        }
    }
    slots
}

struct SomePixels<'a> {
    problem: &'a Problem<'a>,
    scale: f32,
    stride: usize,
    pixels: &'a [u32],
    costs: &'a mut [u16],
    is_inside: &'a mut [bool],
    scratch: &'a mut PixelScratch,
}

impl WithSimd for SomePixels<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let of = Costs { problem: self.problem, scale: self.scale };
        for ((pixel, row), inside) in
            self.pixels.iter().zip(self.costs.chunks_exact_mut(self.stride)).zip(self.is_inside)
        {
            row.fill(OUTSIDE);
            *inside = of.of_pixel::<S>(*pixel, row, self.scratch);
        }
    }
}

struct SomeWinners<'a> {
    /// Sums of path costs, in two parts, `[pixel][hypothesis]`.
    sums: [&'a [u16]; 2],
    costs: &'a [u16],
    stride: usize,
    count: usize,
    scale: f32,
    out: &'a mut [Winner],
}

impl WithSimd for SomeWinners<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { sums: [first, second], costs, stride, count, scale, out } = self;
        let mut sums = vec![OUTSIDE; stride];
        let rows = first.chunks_exact(stride).zip(second.chunks_exact(stride)).zip(costs.chunks_exact(stride));
        for (((first, second), costs), out) in rows.zip(out) {
            for l in 0..stride {
                let sum = first[l] + second[l];
                sums[l] = if costs[l] == OUTSIDE { OUTSIDE } else { sum };
            }
            *out = choose(&sums[..count], 1.0 / scale);
        }
    }
}

/// Returns the winner of a pixel with the given sums of eighths of path costs, in some unit; [`OUTSIDE`] where the
/// hypothesis is.
#[inline(always)]
fn choose(sums: &[u16], unit: f32) -> Winner {
    let lowest = least(sums);
    let best = sums.iter().position(|s| *s == lowest).unwrap_or(0);
    if lowest == OUTSIDE {
        return Winner::NONE;
    }
    let (before, behind) = (&sums[..best.saturating_sub(NEAR)], &sums[(best + NEAR + 1).min(sums.len())..]);
    // A rival that is outside costs what everything outside does.
    let rival = match least(before).min(least(behind)) {
        OUTSIDE if before.is_empty() && behind.is_empty() => f32::INFINITY,
        OUTSIDE => problem::OUTSIDE,
        rival => f32::from(rival) * unit,
    };
    let mut index = best as f32;
    if best > 0 && best + 1 < sums.len() && sums[best - 1] < OUTSIDE && sums[best + 1] < OUTSIDE {
        let (a, b, c) = (f32::from(sums[best - 1]), f32::from(lowest), f32::from(sums[best + 1]));
        let bend = a - 2.0 * b + c;
        if bend > 0.0 {
            index += (0.5 * (a - c) / bend).clamp(-0.5, 0.5);
        }
    }
    Winner { index, margin: rival - f32::from(lowest) * unit }
}

/// Returns the least of some sums; [`OUTSIDE`] of none.
#[inline(always)]
fn least(sums: &[u16]) -> u16 {
    let (chunks, rest) = sums.as_chunks::<CHUNK>();
    let mut lanes = [OUTSIDE; CHUNK];
    for chunk in chunks {
        for l in 0..CHUNK {
            lanes[l] = lanes[l].min(chunk[l]);
        }
    }
    lanes.iter().chain(rest).fold(OUTSIDE, |a, b| a.min(*b))
}
