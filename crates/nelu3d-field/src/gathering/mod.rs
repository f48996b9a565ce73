//! Light that arrives at points from diffuse patches: a sum over all patches of what each sends, times its form factor
//! from the point, `cos θ_point cos θ_patch area / (π r² + area)`, that of a disc that faces the point, finite however
//! near (Wallace et al. 1989, *A Ray Tracing Algorithm for Progressive Radiosity*).
//!
//! [`mod@reference`] is the plain form; [`gather`] takes many patches at a time for a few points.

mod cpu;
pub mod reference;

pub use cpu::gather;

use crate::bench::Demand;

/// Squared distance that is added to every other, so that none is 0, mm².
const NEAR: f32 = 1e-6;

/// Diffuse patches, component by component.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Patches {
    /// Centers, mm.
    pub center: [Vec<f32>; 3],
    /// Unit normals.
    pub normal: [Vec<f32>; 3],
    /// Areas, mm².
    pub area: Vec<f32>,
    /// What patches send: one list per value.
    pub sent: Vec<Vec<f32>>,
}

impl Patches {
    /// Returns the number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// Returns whether there are none.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// Panics if a length does not fit.
    fn check(&self) {
        let lists = self.center.iter().chain(&self.normal).chain(&self.sent);
        assert!(lists.into_iter().all(|v| v.len() == self.len()), "one value per patch");
    }
}

/// A point on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Receiver {
    /// Where it is, mm.
    pub point: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
}

/// Returns what gathering at `points` points from `patches` patches that send `values` values asks of the machine.
/// Patches stay in a cache.
pub fn demand(points: usize, patches: usize, values: usize) -> Demand {
    Demand { flops: points as f64 * patches as f64 * (30.0 + 2.0 * values as f64), ..Demand::default() }
}
