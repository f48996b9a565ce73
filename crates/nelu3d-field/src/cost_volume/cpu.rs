//! The fast form on the CPU: pixels in parallel, paths row by row.

use super::aggregate::{Aggregation, NO_SLOT};
use super::misfit::misfit;
use super::problem::{DIRECTIONS, NEAR, OUTSIDE, Problem, Winner};
use crate::lattice::LatticeEvaluator;
use rayon::prelude::*;

/// Returns the winner of every pixel; see [`super::winners`].
pub(super) fn winners(problem: &Problem<'_>) -> Vec<Winner> {
    let count = problem.hypotheses.count;
    // Costs could be stored in 16 bits, but the sums of eight paths need the range of 32.
    let mut costs = vec![0.0f32; problem.pixels.len() * count];
    let slots = compute_costs(problem, &mut costs);
    let mut sums = vec![0.0f32; costs.len()];
    let aggregation = Aggregation {
        width: problem.width,
        height: problem.height,
        pixels: problem.pixels,
        slots: &slots,
        count,
        costs: &costs,
        step: problem.step,
        jump: problem.jump,
    };
    for direction in DIRECTIONS {
        aggregation.add(&mut sums, direction);
    }
    let rows = sums.par_chunks(count).zip(costs.par_chunks(count));
    rows.map(|(sums, costs)| choose(sums, costs)).collect()
}

/// Writes the costs `[slot][hypothesis]`; returns the slot of every pixel of the image that a path passes.
fn compute_costs(problem: &Problem<'_>, costs: &mut [f32]) -> Vec<u32> {
    let spline = LatticeEvaluator::new(problem.lattice);
    let rows = costs.par_chunks_mut(problem.hypotheses.count).enumerate();
    let is_inside: Vec<bool> = rows
        .map_init(|| vec![0.0; problem.lattice.k], |c, (slot, row)| pixel_costs(problem, &spline, slot, c, row))
        .collect();
    let mut slots = vec![NO_SLOT; problem.width * problem.height];
    for ((slot, pixel), is_inside) in problem.pixels.iter().enumerate().zip(is_inside) {
        if is_inside {
            slots[*pixel as usize] = slot as u32;
        }
    }
    slots
}

/// Writes a pixel's costs; returns whether any hypothesis is inside. `c` is scratch memory for a codeword.
#[inline(always)]
fn pixel_costs(
    problem: &Problem<'_>,
    spline: &LatticeEvaluator<'_>,
    slot: usize,
    c: &mut [f32],
    row: &mut [f32],
) -> bool {
    let (pixel, k) = (problem.pixels[slot], c.len());
    let (ray, at) = (problem.rays.ray(pixel), pixel as usize * k);
    let measured = [problem.p, problem.inv_var, problem.surround].map(|v| &v[at..at + k]);
    row.fill(OUTSIDE);
    let mut is_inside = false;
    for l in ray.range[0] as usize..ray.range[1] as usize {
        let q = ray.at(&problem.frame, problem.center, problem.hypotheses.distance(l, ray.dir_z));
        if problem.lit.contains(q) {
            is_inside = true;
            spline.eval(q, c);
            row[l] = misfit(measured, c, problem.prior, problem.saturation);
        }
    }
    is_inside
}

/// Returns the winner of a pixel with the given sums of path costs and costs.
fn choose(sums: &[f32], costs: &[f32]) -> Winner {
    let count = sums.len();
    let best = (0..count).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("there are hypotheses");
    if costs[best] >= OUTSIDE {
        return Winner::NONE;
    }
    let rivals = (0..count).filter(|l| l.abs_diff(best) > NEAR).map(|l| sums[l]);
    let rival = rivals.min_by(f32::total_cmp).unwrap_or(f32::INFINITY);
    let mut index = best as f32;
    if best > 0 && best + 1 < count {
        let (a, b, c) = (sums[best - 1], sums[best], sums[best + 1]);
        let bend = a - 2.0 * b + c;
        if bend > 1e-6 && a < OUTSIDE && c < OUTSIDE {
            index += (0.5 * (a - c) / bend).clamp(-0.5, 0.5);
        }
    }
    Winner { index, margin: (rival - sums[best]) / DIRECTIONS.len() as f32 }
}
