//! Which label explains each pixel of an image best, when neighbors tend to have the same one: a cost volume over a lattice that
//! is known, aggregated by semi-global matching (Hirschmüller 2008, *Stereo Processing by Semiglobal Matching and Mutual
//! Information*, Sec. 2.3).
//!
//! A pixel's labels lie on a straight line through a projective frame; in the coordinates q of the lattice that is
//! `q(l) = origin + (l − at) · slope / (1 + (l − at) · bend)` ([`Ray`]). The lattice's codeword c(q) is compared with the measured
//! one p. Part of the light may not be in c: a share a of it has the codeword 1 everywhere, a share b that of the surroundings:
//!
//! ```text
//! E(a, b) = Σ_j inv_var_j · (p_j − c_j − a (1 − c_j) − b (surround_j − c_j))² + prior_0 a² + prior_1 b²
//! cost    = E* / (1 + E* / saturation)          E* = E at its minimum over 0 ≤ a, b; both then at most 0.45
//! ```
//!
//! Labels outside the lattice, or in a part of it that is not lit, cost [`OUTSIDE`]. Pixels all of whose labels are outside take no part:
//! the paths of the aggregation end before them and begin anew behind them, as at pixels that are no part of the problem.
//! Path costs along eight directions are summed, one direction after the other, so that results are the same in every run.

#[cfg(feature = "gpu")]
mod gpu;
pub mod reference;

use crate::device::{Device, DeviceError};

/// Cost of a label outside the lattice: never chosen beside others, but finite so that sums stay finite.
pub const OUTSIDE: f32 = 1e6;

/// Labels this close to the best are no rivals of it.
pub const NEAR: usize = 3;

/// Steps between the pixels of a path, in the order in which their costs are summed.
pub const DIRECTIONS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]];

/// A uniform tricubic B-spline on the unit cube.
#[derive(Clone, Copy, Debug)]
pub struct Lattice<'a> {
    /// Cells along a, b and w.
    pub cells: [usize; 3],
    /// Channels.
    pub k: usize,
    /// `[b][a][w][k]`, one node more before and two more behind the cells of each axis: `(cells + 3)` nodes along it.
    pub nodes: &'a [f32],
}

/// Where in the unit cube the lattice means something.
#[derive(Clone, Copy, Debug)]
pub struct Lit<'a> {
    /// Cells along a, b and w.
    pub cells: [usize; 3],
    /// `[b][a][w]`, 1 where it does.
    pub lit: &'a [u8],
}

/// Where in the unit cube a pixel's labels are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ray {
    /// q of the label `at`.
    pub origin: [f32; 3],
    /// A label, preferably among those of [`Self::labels`].
    pub at: f32,
    /// Derivative of q by the label there.
    pub slope: [f32; 3],
    /// Relative change per label of the projective denominator; labels for which that is not positive are outside.
    pub bend: f32,
    /// First label and the one after the last; all others are outside.
    pub labels: [u32; 2],
}

impl Ray {
    /// The ray that has no labels.
    pub const NONE: Self = Self { origin: [0.0; 3], at: 0.0, slope: [0.0; 3], bend: 0.0, labels: [0; 2] };

    /// The line `l ↦ h_0..2 / h_3` with `h = base + l · step` in homogeneous coordinates, for the given labels.
    pub fn new(base: [f64; 4], step: [f64; 4], labels: [u32; 2]) -> Self {
        if labels[0] >= labels[1] {
            return Self::NONE;
        }
        // From the end that is farther from the pole, numbers only get smaller.
        let denominator = |l: u32| base[3] + f64::from(l) * step[3];
        let [first, last] = [labels[0], labels[1] - 1];
        let at = if denominator(first) >= denominator(last) { first } else { last };
        let pole = denominator(at);
        if pole <= 0.0 || !pole.is_finite() {
            return Self::NONE;
        }
        let q: [f64; 3] = std::array::from_fn(|i| (base[i] + f64::from(at) * step[i]) / pole);
        Self {
            origin: q.map(|v| v as f32),
            at: at as f32,
            slope: std::array::from_fn(|i| ((step[i] - q[i] * step[3]) / pole) as f32),
            bend: (step[3] / pole) as f32,
            labels,
        }
    }
}

/// An image to be labeled.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// The N pixels (`y · width + x`) that take part, ascending.
    pub pixels: &'a [u32],
    /// Labels of each.
    pub labels: usize,
    /// Their rays, N.
    pub rays: &'a [Ray],
    /// Measured codewords of the whole image, `width · height × k`.
    pub p: &'a [f32],
    /// One over their variances, `width · height × k`; 0 for a channel that says nothing.
    pub inv_var: &'a [f32],
    /// Codewords of the pixels' surroundings, `width · height × k`.
    pub surround: &'a [f32],
    /// What the codewords are compared with.
    pub lattice: Lattice<'a>,
    /// Where it holds.
    pub lit: Lit<'a>,
    /// Weights of the squares of the shares a and b.
    pub prior: [f32; 2],
    /// Where costs saturate.
    pub saturation: f32,
    /// Cost of a step to the next label between neighbors (P1).
    pub step: f32,
    /// Cost of any larger step (P2).
    pub jump: f32,
}

impl Problem<'_> {
    fn check(&self) {
        let (n, k) = (self.width * self.height, self.lattice.k);
        assert!(self.labels > 0 && k > 0 && self.labels < 1 << 24);
        assert_eq!(self.rays.len(), self.pixels.len());
        assert!(self.pixels.is_sorted_by(|a, b| a < b) && self.pixels.last().is_none_or(|i| (*i as usize) < n));
        assert!(self.rays.iter().all(|r| r.labels[1] as usize <= self.labels));
        assert!([self.p, self.inv_var, self.surround].iter().all(|v| v.len() == n * k));
        assert_eq!(self.lattice.nodes.len(), self.lattice.cells.iter().map(|c| c + 3).product::<usize>() * k);
        assert!(self.lattice.cells.iter().chain(&self.lit.cells).all(|c| *c > 0));
        assert_eq!(self.lit.lit.len(), self.lit.cells.iter().product::<usize>());
    }
}

/// The label of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winner {
    /// The best label (of equal ones the first), moved by at most half a label to the minimum of the parabola through it and its neighbors; NaN
    /// if all are outside.
    pub label: f32,
    /// How much less it costs, summed over paths, than the best label more than [`NEAR`] away, divided by the number of
    /// paths; infinite if there is no such label.
    pub margin: f32,
}

impl Winner {
    /// All labels are outside.
    pub const NONE: Self = Self { label: f32::NAN, margin: 0.0 };
}

/// The winner of every pixel that takes part. On the CPU this is the plain [`mod@reference`].
///
/// # Errors
///
/// The device failed, or the problem is too large for it.
///
/// # Panics
///
/// If a length does not fit.
pub fn winners(device: &Device, problem: &Problem<'_>) -> Result<Vec<Winner>, DeviceError> {
    problem.check();
    match device {
        Device::Cpu => Ok(reference::winners::<f32>(problem)),
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => gpu::winners(gpu, problem, gpu.most_buffer_bytes()),
    }
}

#[cfg(test)]
mod tests;
