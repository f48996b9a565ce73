//! Small components of the decoded surface: a wrong period of the code, or a small object.

use nelu3d_scan::Camera;

use crate::color_field::{CameraRays, SplineEvaluator};
use crate::reconstruct::cost_volume::chi2_of_codeword;
use crate::reconstruct::maps::fill_from_neighbors;
use crate::reconstruct::settings::FastSettings;
use crate::sensor::Measurements;
use crate::surface::{Links, MAX_SLOPE};

/// Range of the search around the surroundings' depth, hypotheses: a slanted surface changes that much across a
/// component.
const SEARCH_RANGE: i32 = 10;
/// χ² per pixel that agreeing with the surroundings is worth.
const AGREEMENT_CHI2: f32 = 6.0;
/// A component is small when it holds less than one over this many of all decoded pixels.
const SMALL_PART: u32 = 50;

/// The small components of a decoded surface, and what decides on them.
///
/// A wrong period of the code looks like a small component far in front of or behind its surroundings; so does a small
/// object. A component takes over its surroundings' depth when its codewords are explained there (within a few
/// hypotheses) nearly as well as where it was decoded. What is then still too small gets no depth.
pub(super) struct SmallComponents<'a> {
    pub(super) spline: &'a SplineEvaluator<'a>,
    pub(super) settings: &'a FastSettings,
    pub(super) m: &'a Measurements,
    /// Rays of the measurements' image.
    pub(super) rays: &'a CameraRays,
    /// Camera of the measurements' image.
    pub(super) camera: &'a Camera,
    /// Spacing of the depth hypotheses in 1/z, 1/mm.
    pub(super) step: f32,
}

impl SmallComponents<'_> {
    /// Corrects or removes small components of an inverse depth map, 1/mm.
    pub(super) fn settle(&self, inv_z: &mut [f32]) {
        let depth: Vec<f32> = inv_z.iter().map(|v| 1.0 / v).collect();
        let (component, sizes) = Links::new(&depth, self.camera, MAX_SLOPE).components(&depth, self.camera.width);
        let n_decoded: u32 = sizes.iter().sum();
        let is_small: Vec<bool> = sizes.iter().map(|s| *s < n_decoded / SMALL_PART).collect();
        let mut around: Vec<f32> = inv_z.to_vec();
        for (v, c) in around.iter_mut().zip(&component) {
            if *c != u32::MAX && is_small[*c as usize] {
                *v = f32::NAN;
            }
        }
        fill_from_neighbors(&mut around, &self.m.status, self.camera.width);
        let excess = self.excess(inv_z, &around, &component, &is_small);
        for i in 0..inv_z.len() {
            if component[i] == u32::MAX {
                continue;
            }
            let c = component[i] as usize;
            if is_small[c] && excess[c] < AGREEMENT_CHI2 * sizes[c] as f32 {
                inv_z[i] = around[i];
            } else if (sizes[c] as usize) < self.settings.min_component {
                inv_z[i] = f32::NAN;
            }
        }
    }

    /// Returns, per small component, Σ over its pixels of (χ² at the surroundings' depth − χ² where it was decoded).
    fn excess(&self, inv_z: &[f32], around: &[f32], component: &[u32], is_small: &[bool]) -> Vec<f32> {
        let m = self.m;
        let prior = self.settings.light_fractions.weights(m);
        let cost = |i: usize, inv_z: f32| {
            let mut c = vec![0.0; m.k];
            let t = f64::from(1.0 / (inv_z * self.rays.dir_z(i)));
            self.spline.eval(self.rays.in_frame(i).at(t).q, &mut c);
            chi2_of_codeword(m, i, &c, prior)
        };
        let mut excess = vec![0.0f32; is_small.len()];
        for i in 0..inv_z.len() {
            if component[i] == u32::MAX || !is_small[component[i] as usize] {
                continue;
            }
            excess[component[i] as usize] += if around[i].is_nan() {
                f32::INFINITY
            } else {
                let near = (-SEARCH_RANGE..=SEARCH_RANGE)
                    .map(|o| cost(i, around[i] + o as f32 * self.step))
                    .fold(f32::INFINITY, f32::min);
                near - cost(i, inv_z[i])
            };
        }
        excess
    }
}
