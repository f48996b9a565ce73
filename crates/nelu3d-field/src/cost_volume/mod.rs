//! Which depth explains each pixel of an image best, when neighbors tend to have the same one: a cost volume over a
//! known lattice, aggregated by semi-global matching (Hirschmüller 2008, *Stereo Processing by Semiglobal Matching and
//! Mutual Information*, Sec. 2.3).
//!
//! Every pixel tries the same [`DepthHypotheses`], even in inverse depth; where they lie in the lattice is told by the
//! pixel's [`PixelRay`]. The lattice's codeword c is compared with the measured one p. Part of the light may not be in
//! c: a fraction a of it has the codeword 1 everywhere (ambient light), a fraction b that of the surroundings
//! (interreflection):
//!
//! ```text
//! E(a, b) = Σ_j inv_var_j · (p_j − c_j − a (1 − c_j) − b (surround_j − c_j))² + prior_0 a² + prior_1 b²
//! cost    = E* / (1 + E* / saturation)          E* = E at its minimum over 0 ≤ a, b; both then at most 0.45
//! ```
//!
//! Hypotheses outside the lattice, or in a part of it that is not lit, cost [`OUTSIDE`]. Pixels all of whose hypotheses
//! are outside take no part: the paths of the aggregation end before them and begin anew behind them, as at pixels that
//! are no part of the problem. Path costs along eight directions are summed, one direction after the other, so that
//! results are the same in every run.
//!
//! [`mod@reference`] is the plain form, which the tests compare with; `cpu.rs` and `gpu.rs` are the fast ones.

mod aggregate;
mod costs;
mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
mod hypotheses;
mod misfit;
mod problem;
pub mod reference;

pub use hypotheses::{DepthHypotheses, HypothesisLine, PixelRay, RaySource};
pub use misfit::{LightFractionEquations, misfit};
pub use problem::{DIRECTIONS, LitCells, NEAR, OUTSIDE, Problem, Winner};

use crate::bench::Demand;
use crate::device::{Device, DeviceError};

/// Returns what a search on the CPU asks of the machine: `inside` hypotheses of all pixels together that lie in their
/// ranges, `stored` of all pixels, k channels. Operations on 16 bits, of which a vector holds twice as many, count
/// half.
pub fn demand(inside: usize, stored: usize, k: usize) -> Demand {
    let (inside, stored, k) = (inside as f64, stored as f64, k as f64);
    // Points and cells, weights, nodes, the sum along w, and the misfit.
    let cost = 12.0 + 36.0 + 51.0 + 16.0 + 136.0 * k + 14.0 * k + 40.0;
    // Eight paths of nine operations; the winner.
    let paths = 8.0 * 9.0 / 2.0 + 6.0;
    // Costs written and read three times; two sums, written, changed by the second pass, and read.
    let bytes = 2.0 * (2.0 + 3.0 + 2.0 * 2.0 + 2.0 + 3.0);
    Demand { flops: inside * cost + stored * paths, bytes: stored * bytes, ..Demand::default() }
}

/// Returns the winner of every pixel that takes part.
///
/// # Errors
///
/// The device failed, or the problem is too large for it. The CPU never fails.
///
/// # Panics
///
/// If a length does not fit.
pub fn winners(device: &Device, problem: &Problem<'_>) -> Result<Vec<Winner>, DeviceError> {
    problem.check();
    match device {
        Device::Cpu => Ok(cpu::winners(problem)),
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => gpu::winners(gpu, problem, gpu.max_buffer_bytes()),
    }
}
