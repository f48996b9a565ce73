//! The rays of one step, and how they are cut into blocks.

use crate::mlp::cpu::BLOCK;
use std::ops::Range;

/// Rays of one step. Ray r owns the samples `offsets[r]..offsets[r + 1]`, front to back, any number of them.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceBatch<'a> {
    /// First sample of every ray and, last, the number of samples.
    pub offsets: &'a [usize],
    /// Where the samples lie, in the unit cube.
    pub points: &'a [[f32; 3]],
    /// Their codewords c, `[sample][k]`.
    pub colors: &'a [f32],
    /// Measured codewords P, `[ray][k]`.
    pub measured: &'a [f32],
    /// I_white, `[ray][k]`; empty for 1.
    pub white: &'a [f32],
    /// Ambient fraction A, `[ray][k]`; empty for 0.
    pub ambient: &'a [f32],
    /// The mask M of every ray, 0 or 1.
    pub mask: &'a [f32],
    /// The samples as midpoints of intervals; `None` where samples are the ends of sections (NeuS, Eq. 13).
    pub intervals: Option<Intervals<'a>>,
}

/// The intervals around samples whose alphas are taken at midpoints, see [`crate::volrend::midpoint`].
#[derive(Clone, Copy, Debug)]
pub struct Intervals<'a> {
    /// Their lengths δ, one per sample, in the unit of the signed distance.
    pub lengths: &'a [f32],
    /// Unit directions of the rays, along the axes of the cube.
    pub dirs: &'a [[f32; 3]],
    /// How far the cosine is annealed, r from 0 to 1.
    pub anneal: f32,
}

impl SurfaceBatch<'_> {
    /// Returns the number of rays.
    pub fn n_rays(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Returns the length of a codeword.
    pub fn k(&self) -> usize {
        self.measured.len() / self.n_rays().max(1)
    }

    /// Panics if a length does not fit.
    pub(super) fn check(&self, d_ambient: &[f32]) {
        let (n_rays, n_samples, k) = (self.n_rays(), self.points.len(), self.k());
        assert!(self.offsets[0] == 0 && self.offsets[n_rays] == n_samples && self.offsets.is_sorted());
        assert!(self.measured.len() == n_rays * k && self.colors.len() == n_samples * k && self.mask.len() == n_rays);
        assert!(self.white.is_empty() || self.white.len() == n_rays * k);
        assert!(self.ambient.is_empty() || self.ambient.len() == n_rays * k);
        assert!(d_ambient.is_empty() || d_ambient.len() == n_rays * k);
        if let Some(intervals) = &self.intervals {
            assert!(intervals.lengths.len() == n_samples && intervals.dirs.len() == n_rays);
        }
    }
}

/// Returns ranges of whole rays that are worked on together: as many as fit into [`BLOCK`] samples, or one longer ray.
/// Ray r owns the samples `offsets[r]..offsets[r + 1]`.
pub fn blocks(offsets: &[usize]) -> impl Iterator<Item = Range<usize>> + '_ {
    let n_rays = offsets.len() - 1;
    let mut start = 0;
    std::iter::from_fn(move || {
        let first = start;
        while start < n_rays && (start == first || offsets[start + 1] - offsets[first] <= BLOCK) {
            start += 1;
        }
        (start > first).then_some(first..start)
    })
}

/// Returns the samples that the eikonal loss takes: in every block of whole rays of up to 96 samples (or one longer
/// ray), each `every`-th, the first included. A network's masks then fall together, and rays share the load evenly.
pub fn eikonal_samples(offsets: &[usize], every: usize) -> impl Iterator<Item = usize> + '_ {
    let some = blocks(offsets).filter(move |_| every > 0);
    some.flat_map(move |rays| (offsets[rays.start]..offsets[rays.end]).step_by(every.max(1)))
}
