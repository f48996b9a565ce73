//! The linear system of a surface over the pixels of an image: what every pixel measures, and a thin plate between
//! neighbors that can break.
//!
//! With the surface x, the data's information h and gradient g at x, and the second differences D along x, along y and
//! mixed with their weights W, the change δ minimizes
//!
//! ```text
//! Σ_i (½ h_i δ_i² + g_i δ_i) + ½ Σ_d w_d (D (x + δ))_d²,   so   (diag(h) + DᵀWD) δ = −g − DᵀWD x
//! ```
//!
//! [`mod@reference`] solves it for all pixels together. [`sweep()`] goes through tiles that stay in a cache and solves
//! each with everything around it at rest, which lowers the same sum; tiles lie elsewhere in the next sweep, so that
//! no pixel stays at an edge. Where pixels measure something, the plate couples them over a few pixels only, and a few
//! sweeps leave nothing to be done.

mod cpu;
mod product;
pub mod reference;
mod solve;
mod tile;

pub use cpu::{Sweep, sweep};

/// A thin plate over a window of `width × height` pixels, row by row, and what its pixels measure. The outermost ring
/// of pixels is not active.
#[derive(Clone, Copy, Debug)]
pub struct PlateSystem<'a> {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Pixels that are part of the surface.
    pub active: &'a [bool],
    /// Weights of the second differences along x centered on a pixel; 0 where a member is not active.
    pub xx: &'a [f32],
    /// Weights of those along y, likewise.
    pub yy: &'a [f32],
    /// Weights of the mixed differences over the 2 × 2 pixels whose top-left one this is, likewise.
    pub xy: &'a [f32],
    /// Information h of a pixel's measurements; 0 where it is not active.
    pub h: &'a [f32],
    /// Gradient g of a pixel's measurements; 0 where it is not active.
    pub g: &'a [f32],
}

impl PlateSystem<'_> {
    /// Panics if a length does not fit.
    fn check(&self, x: &[f32]) {
        let n = self.width * self.height;
        assert!(self.width >= 3 && self.height >= 3, "a window has a ring");
        assert!([self.xx, self.yy, self.xy, self.h, self.g, x].iter().all(|v| v.len() == n) && self.active.len() == n);
    }
}

/// The criterion by which the solution of a system, or of a tile, is good enough: whichever is reached first. The
/// residual is measured in the preconditioner's norm, Σ r² / diagonal: twice what a step along it would gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateStop {
    /// Factor by which the residual's norm is reduced.
    pub reduction: f64,
    /// Squared norm of the residual per active pixel at which nothing is left to be gained.
    pub settled: f64,
    /// Largest number of iterations.
    pub iterations: usize,
}
