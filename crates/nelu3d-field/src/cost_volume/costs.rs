//! The costs of a pixel's hypotheses, many of them side by side: where they lie, how much each node of the lattice
//! counts, and the misfit are computed in lanes; only the nodes are read one hypothesis after the other.

use pulp::Simd;

use super::hypotheses::HypothesisLine;
use super::problem::{LitCells, Problem};
use crate::lattice::Lattice;
use crate::lattice::lanes::{
    LANES, Lanes, Place, ROUND, SUMS, first_node, mul_add, of_lane, offsets, place, store, sum_over_ab, sum_over_w,
    weights_of,
};
use crate::lattice::many::{self, GROUP, Sums};

/// What does not change from pixel to pixel.
pub(super) struct Costs<'a> {
    pub(super) problem: &'a Problem<'a>,
    /// Units of a stored cost per unit of cost.
    pub(super) scale: f32,
}

/// Scratch memory for a pixel.
#[derive(Default)]
pub(super) struct PixelScratch {
    /// Codewords, a channel after the other.
    c: Vec<Lanes>,
    /// One codeword of many channels.
    one: Vec<f32>,
    /// Sums of nodes of many channels.
    sums: Sums<1>,
}

impl Costs<'_> {
    /// Writes the costs of the hypotheses of a pixel that are inside; all others keep what they have. Returns whether
    /// there are any. `row` begins with hypothesis 0 and is a multiple of [`LANES`] long.
    #[inline(always)]
    pub(super) fn of_pixel<S: Simd>(&self, pixel: u32, row: &mut [u16], scratch: &mut PixelScratch) -> bool {
        let problem = self.problem;
        let k = problem.lattice.k;
        let line = problem.rays.ray(pixel).line(&problem.frame, problem.center, &problem.hypotheses);
        let at = pixel as usize * k;
        let measured = [problem.p, problem.inv_var, problem.surround].map(|v| &v[at..at + k]);
        scratch.c.resize(k, [0.0; LANES]);
        if k > 6 {
            scratch.one.resize(many::room(k), 0.0);
            scratch.sums.resize(k);
        }
        let [first, end] = line.range.map(|l| l as usize);
        let mut any = false;
        for begin in (first / LANES * LANES..end).step_by(LANES) {
            let (q, is_inside) = points(&line, begin);
            let mut lit = [false; LANES];
            for l in 0..LANES {
                let in_range = first <= begin + l && begin + l < end;
                lit[l] = in_range && is_inside[l];
            }
            look_up(&problem.lit, &q, &mut lit);
            if !lit.contains(&true) {
                continue;
            }
            any = true;
            match k {
                1 => codewords::<S, 1>(&problem.lattice, &q, &lit, &mut scratch.c),
                2 => codewords::<S, 2>(&problem.lattice, &q, &lit, &mut scratch.c),
                3 => codewords::<S, 3>(&problem.lattice, &q, &lit, &mut scratch.c),
                4 => codewords::<S, 4>(&problem.lattice, &q, &lit, &mut scratch.c),
                5 => codewords::<S, 5>(&problem.lattice, &q, &lit, &mut scratch.c),
                6 => codewords::<S, 6>(&problem.lattice, &q, &lit, &mut scratch.c),
                _ => codewords_of_many::<S>(&problem.lattice, &q, &lit, scratch),
            }
            let costs = misfits::<S>(measured, &scratch.c, problem.prior, problem.saturation);
            let row = &mut row[begin..begin + LANES];
            for l in 0..LANES {
                // The last bits of a rounded value are an integer.
                let stored = (costs[l] * self.scale + ROUND).to_bits() as u16;
                row[l] = if lit[l] { stored } else { row[l] };
            }
        }
        any
    }
}

/// Returns the unit coordinates of hypotheses from number `begin` on, and which lie in the unit cube.
#[inline(always)]
fn points(line: &HypothesisLine, begin: usize) -> ([Lanes; 3], [bool; LANES]) {
    let (mut q, mut is_inside) = ([[0.0; LANES]; 3], [false; LANES]);
    for l in 0..LANES {
        let d = (begin + l) as u32 as i32 as f32 - line.at;
        let pole = 1.0 + d * line.bend;
        let along = d / pole;
        let mut inside = pole > 0.0;
        for i in 0..3 {
            let v = line.origin[i] + along * line.slope[i];
            inside &= (0.0..=1.0).contains(&v);
            q[i][l] = v;
        }
        is_inside[l] = inside;
    }
    (q, is_inside)
}

/// Leaves those hypotheses in `lit` whose cells are lit.
#[inline(always)]
fn look_up(cells: &LitCells<'_>, q: &[Lanes; 3], lit: &mut [bool; LANES]) {
    let [a, b, w] = [place(&q[0], cells.cells[0]), place(&q[1], cells.cells[1]), place(&q[2], cells.cells[2])];
    for l in 0..LANES {
        let cell = (b.cell[l] as usize * cells.cells[0] + a.cell[l] as usize) * cells.cells[2] + w.cell[l] as usize;
        lit[l] &= cells.lit[cell] == 1;
    }
}

/// Writes the codewords of lit hypotheses, for K channels.
#[inline(always)]
fn codewords<S: Simd, const K: usize>(lattice: &Lattice<'_>, q: &[Lanes; 3], lit: &[bool; LANES], c: &mut [Lanes]) {
    let ([a, b, w], ab, ww) = weights(lattice, q);
    let offsets = offsets(lattice);
    let mut stored = [[0.0f32; SUMS]; LANES];
    for l in 0..LANES {
        if !lit[l] {
            continue;
        }
        let first = first_node(lattice, [&a, &b, &w], l);
        let sums = sum_over_ab::<S, K>(lattice.nodes, first, &offsets, &ab, l);
        store(&sums, &mut stored[l]);
    }
    for l in 0..LANES {
        let codeword = sum_over_w::<S, K>(&stored[l], of_lane(&ww, l));
        for ch in 0..K {
            c[ch][l] = codeword[ch];
        }
    }
}

/// Writes the codewords of lit hypotheses, for more than six channels.
#[inline(always)]
fn codewords_of_many<S: Simd>(lattice: &Lattice<'_>, q: &[Lanes; 3], lit: &[bool; LANES], scratch: &mut PixelScratch) {
    let (places, ab, ww) = weights(lattice, q);
    let (offsets, ab) = (offsets(lattice), [ab]);
    for begin in (0..LANES).step_by(GROUP) {
        for l in (begin..begin + GROUP).filter(|l| lit[*l]) {
            let first = first_node(lattice, places.each_ref(), l);
            scratch.sums.set::<S>(l - begin, lattice.nodes, first, &offsets, &ab, l);
        }
        for l in (begin..begin + GROUP).filter(|l| lit[*l]) {
            let sums = scratch.sums.get(l - begin, 0);
            many::sum_over_w::<S, _>(lattice.k, [(sums, of_lane(&ww, l))], &mut scratch.one);
            scratch.c.iter_mut().zip(&scratch.one).for_each(|(c, v)| c[l] = *v);
        }
    }
}

/// Returns the places of points, the weights of their 16 rows of nodes, `[4 j + i]`, and those along w.
#[inline(always)]
fn weights(lattice: &Lattice<'_>, q: &[Lanes; 3]) -> ([Place; 3], [Lanes; 16], [Lanes; 4]) {
    let [a, b, w] = [place(&q[0], lattice.cells[0]), place(&q[1], lattice.cells[1]), place(&q[2], lattice.cells[2])];
    let [wa, wb, ww] = [weights_of(&a.position), weights_of(&b.position), weights_of(&w.position)];
    let mut ab = [[0.0f32; LANES]; 16];
    for j in 0..4 {
        for i in 0..4 {
            for l in 0..LANES {
                ab[4 * j + i][l] = wa[i][l] * wb[j][l];
            }
        }
    }
    ([a, b, w], ab, ww)
}

/// Returns what [`super::misfit()`] returns for every codeword.
#[inline(always)]
fn misfits<S: Simd>([p, inv_var, surround]: [&[f32]; 3], c: &[Lanes], prior: [f32; 2], saturation: f32) -> Lanes {
    let mut sums = [[0.0f32; LANES]; 6];
    for (j, c) in c.iter().enumerate() {
        let (p, iv, around) = (p[j], inv_var[j], surround[j]);
        for l in 0..LANES {
            let (r, ambient, indirect) = (p - c[l], 1.0 - c[l], around - c[l]);
            let (ia, ib) = (iv * ambient, iv * indirect);
            sums[0][l] = mul_add::<S>(ia, ambient, sums[0][l]);
            sums[1][l] = mul_add::<S>(ia, indirect, sums[1][l]);
            sums[2][l] = mul_add::<S>(ib, indirect, sums[2][l]);
            sums[3][l] = mul_add::<S>(ia, r, sums[3][l]);
            sums[4][l] = mul_add::<S>(ib, r, sums[4][l]);
            sums[5][l] = mul_add::<S>(iv * r, r, sums[5][l]);
        }
    }
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let [aa, ab, bb] = [sums[0][l], sums[1][l], sums[2][l]];
        let [f, g, e] = [sums[3][l], sums[4][l], sums[5][l]];
        let (a, b) = (aa + prior[0], bb + prior[1]);
        let det = 1.0 / (a * b - ab * ab);
        let both = [(b * f - ab * g) * det, (a * g - ab * f) * det];
        let (alone_a, alone_b) = ((f / a).max(0.0), (g / b).max(0.0));
        let x = if both[0] < 0.0 {
            0.0
        } else if both[1] < 0.0 {
            alone_a
        } else {
            both[0]
        };
        let y = if both[0] < 0.0 {
            alone_b
        } else if both[1] < 0.0 {
            0.0
        } else {
            both[1]
        };
        let (x, y) = (x.min(0.45), y.min(0.45));
        let gain = 2.0 * (x * f + y * g) - a * x * x - b * y * y - 2.0 * ab * x * y;
        let e = (e - gain).max(0.0);
        out[l] = e / (1.0 + e / saturation);
    }
    out
}
