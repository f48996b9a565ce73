//! What a cost volume is made of.

use super::hypotheses::{DepthHypotheses, RaySource};
use crate::lattice::{Lattice, ProjectiveFrame};

/// Cost of a hypothesis outside the lattice: never chosen beside others, but finite so that sums stay finite.
pub const OUTSIDE: f32 = 1e6;

/// Hypotheses at most this far from the best are no rivals of it.
pub const NEAR: usize = 3;

/// Steps between the pixels of a path, in the order in which their costs are summed.
pub const DIRECTIONS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]];

/// The cells of the unit cube in which the lattice means something.
#[derive(Clone, Copy, Debug)]
pub struct LitCells<'a> {
    /// Cells along a, b and w.
    pub cells: [usize; 3],
    /// `[b][a][w]`, 1 where the lattice holds.
    pub lit: &'a [u8],
}

impl LitCells<'_> {
    /// Returns whether the lattice holds at unit coordinates `q`. Outside the cube it does not.
    #[inline(always)]
    pub fn contains(&self, q: [f32; 3]) -> bool {
        let mut cell = [0; 3];
        for i in 0..3 {
            if !(0.0..=1.0).contains(&q[i]) {
                return false;
            }
            cell[i] = ((q[i] * self.cells[i] as f32) as usize).min(self.cells[i] - 1);
        }
        self.lit[(cell[1] * self.cells[0] + cell[0]) * self.cells[2] + cell[2]] == 1
    }
}

/// An image whose depth is sought.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// The N pixels (`y · width + x`) that take part, ascending.
    pub pixels: &'a [u32],
    /// The depths that are tried, the same for all pixels.
    pub hypotheses: DepthHypotheses,
    /// The frame of the lattice.
    pub frame: ProjectiveFrame,
    /// Where all rays begin, along the frame's axes.
    pub center: [f64; 3],
    /// The rays of the N pixels.
    pub rays: &'a dyn RaySource,
    /// Measured codewords of the whole image, `width · height × k`.
    pub p: &'a [f32],
    /// One over their variances, `width · height × k`; 0 for a channel that says nothing.
    pub inv_var: &'a [f32],
    /// Codewords of the pixels' surroundings, `width · height × k`.
    pub surround: &'a [f32],
    /// The codewords c that the measured ones are compared with.
    pub lattice: Lattice<'a>,
    /// Where the lattice holds.
    pub lit: LitCells<'a>,
    /// Weights of the squares of the light fractions a and b.
    pub prior: [f32; 2],
    /// The cost that no misfit exceeds.
    pub saturation: f32,
    /// Cost of a step to the next hypothesis between neighbors (P1).
    pub step: f32,
    /// Cost of any larger step (P2).
    pub jump: f32,
}

impl Problem<'_> {
    /// Panics if a length does not fit.
    pub(super) fn check(&self) {
        let (n, k) = (self.width * self.height, self.lattice.k);
        assert!((1..1 << 24).contains(&self.hypotheses.count));
        assert!(self.pixels.is_sorted_by(|a, b| a < b) && self.pixels.last().is_none_or(|i| (*i as usize) < n));
        assert!([self.p, self.inv_var, self.surround].iter().all(|v| v.len() == n * k));
        self.lattice.check();
        assert!(self.lit.cells.iter().all(|c| *c > 0));
        assert_eq!(self.lit.lit.len(), self.lit.cells.iter().product::<usize>());
    }
}

/// The depth of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winner {
    /// Index of the best hypothesis (of equal ones the first), moved by at most half a hypothesis to the minimum of the
    /// parabola through it and its neighbors; NaN if all are outside.
    pub index: f32,
    /// How much less it costs, summed over paths, than the best hypothesis more than [`NEAR`] away, divided by the
    /// number of paths; infinite if there is no such hypothesis.
    pub margin: f32,
}

impl Winner {
    /// The winner of a pixel all of whose hypotheses are outside.
    pub const NONE: Self = Self { index: f32::NAN, margin: 0.0 };
}
