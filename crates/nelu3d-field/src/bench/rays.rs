//! Inputs: rays along z through a bumpy surface, as `benches/peer/surface_step.py` makes them.

use crate::surface::SurfaceBatch;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::TAU;

/// Patterns.
const K: usize = 3;

/// Rays of one step.
#[derive(Clone, Debug)]
pub struct RaySet {
    offsets: Vec<usize>,
    points: Vec<[f32; 3]>,
    colors: Vec<f32>,
    measured: Vec<f32>,
    mask: Vec<f32>,
}

impl RaySet {
    /// Makes `n_rays` rays of `n_samples`, stratified within ±`band` / 2 of the surface.
    pub fn new(n_rays: usize, n_samples: usize, band: f32, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let code =
            |z: f32| std::array::from_fn::<f32, K, _>(|c| 0.5 + 0.5 * (40.0 * z + TAU * c as f32 / K as f32).cos());
        let mut set =
            Self { offsets: vec![0], points: vec![], colors: vec![], measured: vec![], mask: vec![1.0; n_rays] };
        let mut origins: Vec<[f32; 2]> = (0..n_rays).map(|_| [rng.random(), rng.random()]).collect();
        // As a sampler would hand them out: rays side by side share the coarse levels' cache lines.
        origins.sort_by_key(|xy| morton(xy.map(|x| (x * 65536.0) as u32)));
        for [x, y] in origins {
            let z = 0.5 + 0.1 * (6.0 * x).sin() * (5.0 * y).cos();
            let (low, high) = ((z - band / 2.0).max(0.0), (z + band / 2.0).min(1.0));
            for j in 0..n_samples {
                let z = low + (high - low) * (j as f32 + rng.random::<f32>()) / n_samples as f32;
                set.points.push([x, y, z]);
                set.colors.extend(code(z));
            }
            set.measured.extend(code(z));
            set.offsets.push(set.points.len());
        }
        set
    }

    /// Returns the samples.
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// Returns the first sample of every ray, and the number of samples.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// Returns the rays as one step takes them.
    pub fn batch(&self) -> SurfaceBatch<'_> {
        SurfaceBatch {
            offsets: &self.offsets,
            points: &self.points,
            colors: &self.colors,
            measured: &self.measured,
            white: &[],
            ambient: &[],
            mask: &self.mask,
            intervals: None,
        }
    }
}

/// Bits of two 16-bit coordinates in turn: neighbors along this order are neighbors in the plane.
fn morton([x, y]: [u32; 2]) -> u32 {
    (0..16).fold(0, |key, bit| key | (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1))
}
