//! What this machine can do, and how close the kernels come: for `nelu3d bench` and the divan benches.
//!
//! [`Machine`] measures ceilings: fused multiply-adds, memory read in order and at random. A [`Case`] is a kernel or a
//! training step at a named size, with its [`Demand`] counted by hand: from the two follows the least time the work can
//! take here (a roofline), and the share of it that is reached.
//!
//! Everything runs on one thread unless said otherwise, and is timed in seconds of the processor, best of several:
//! other programs on the machine then disturb least.

mod demand;
mod kernels;
mod machine;
mod rays;
mod report;
mod steps;
mod timing;

pub use demand::{Accesses, Case, Demand};
pub use kernels::kernels;
pub use machine::{Machine, Rate, interpolate};
pub use rays::RaySet;
pub use report::{BenchError, BenchReport, KernelResult, StepResult};
pub use steps::{LineCounts, StepShape, SurfaceBench, steps};
pub use timing::{LINE, best_secs};
