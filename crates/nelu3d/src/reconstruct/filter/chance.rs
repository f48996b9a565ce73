//! Whether a component's codewords are explained better than chance explains anything.
//!
//! How much χ² and how much light of unseen origin a right depth needs differs from scene to scene: a bright wall
//! beside the object sends it a sixth of its light. What a wrong depth achieves can be tried: codewords from elsewhere
//! in the same picture, which cannot belong to a ray, are looked up along it, with the same noise and the same freedom
//! of light. With twenty Gray images next to none of them is explained as well as a right depth is; with three patterns
//! some are. It is a permutation test (Fisher 1935) with the picture's own codewords.

use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use crate::reconstruct::cost_volume::{chi2_of_codeword, chi2_of_weighted};
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::refine::Refined;
use crate::reconstruct::scene::Scene;

/// Smallest and largest number of pixels of a component that are tested.
const TESTED: [usize; 2] = [32, 128];
/// One of so many pixels is tested, between these: of what is large, more hangs on the answer, and the median of few
/// tests is off by a tenth.
const TESTED_OF: usize = 100;
/// Number of foreign codewords per tested pixel.
const FOREIGN: usize = 32;
/// Number of foreign codewords from which a pixel's test says anything.
const MIN_FOREIGN: usize = 16;
/// Distance across the light beyond which a codeword cannot belong to a ray, as a fraction of the field's width: wider
/// than blur and than errors of the field.
pub(super) const MARGIN: f32 = 0.02;

/// The axis across the light along which foreign codewords lie elsewhere than a ray.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Along {
    /// The one that a ray runs along from depth to depth.
    Ray,
    /// The other one. Of a code that changes along the first alone some depth explains all of them; one that changes
    /// along both is tried so where rays run through all that a picture shows.
    Other,
}

/// Codewords of a scene with the places across the light where they were found.
pub(super) struct ForeignCodewords {
    /// Pixel, and its unit coordinates across the light.
    donors: Vec<(usize, [f32; 2])>,
}

impl ForeignCodewords {
    /// Takes codewords from all over a depth map (camera z, mm; NaN where there is none).
    pub(super) fn new(scene: &Scene<'_>, depth: &[f32]) -> Self {
        let found: Vec<usize> = (0..depth.len()).filter(|i| depth[*i].is_finite()).collect();
        let donors = spread(&found, 40 * FOREIGN)
            .map(|i| {
                let q = scene.rays.in_frame(i).at(f64::from(depth[i] / scene.rays.dir_z(i))).q;
                (i, [q[0], q[1]])
            })
            .collect();
        Self { donors }
    }

    /// Returns the fraction of foreign codewords that some depth explains at least as well as the found depth explains
    /// a pixel's own: the median over the pixels of a component; and, likewise, the least χ² of a foreign codeword over
    /// the own one's. `None` where every codeword of the picture may belong to the component's rays. `step` is the
    /// spacing of the depths that are tried in 1/z, 1/mm. Codewords are foreign that lie elsewhere `along` an axis.
    pub(super) fn explained_as_well(
        &self,
        pixels: &[usize],
        scene: &Scene<'_>,
        refined: &Refined,
        prior: &LightFractionPrior,
        step: f32,
        along: Along,
    ) -> Option<[f32; 2]> {
        let prior = prior.weights(&scene.measurements);
        let tested: Vec<usize> = spread(pixels, (pixels.len() / TESTED_OF).clamp(TESTED[0], TESTED[1])).collect();
        let (mut shares, mut ratios): (Vec<f32>, Vec<f32>) =
            tested.par_iter().filter_map(|i| self.test(*i, scene, refined, prior, step, along)).unzip();
        if 2 * shares.len() < tested.len() {
            return None;
        }
        median(&mut shares).zip(median(&mut ratios)).map(|(share, ratio)| [share, ratio])
    }

    /// The test of one pixel: fraction of foreign codewords, and the least χ² of one over the own codeword's.
    fn test(
        &self,
        i: usize,
        scene: &Scene<'_>,
        refined: &Refined,
        prior: [f32; 2],
        step: f32,
        along: Along,
    ) -> Option<(f32, f32)> {
        let Scene { rays, field, measurements: m, .. } = scene;
        let spline = scene.spline();
        let (ray, dir_z) = (rays.in_frame(i), rays.dir_z(i));
        let [near, far] = rays.range[i];
        let at = |inv_z: f32| ray.at(f64::from(1.0 / (inv_z * dir_z))).q;
        let [first, last] = [far, near].map(|t| 1.0 / (t * dir_z));
        let (from, to) = (at(first), at(last));
        // Depth moves a codeword across the light along one of its axes more than along the other.
        let moves = usize::from((to[1] - from[1]).abs() > (to[0] - from[0]).abs());
        let axis = if along == Along::Ray { moves } else { 1 - moves };
        let [low, high] = [from[axis].min(to[axis]) - MARGIN, from[axis].max(to[axis]) + MARGIN];
        // Of codewords of which less is known, more is explained: only what is known of both counts.
        let is_foreign =
            |(j, q): &(usize, [f32; 2])| (q[axis] < low || q[axis] > high) && rays.known[*j].covers(rays.known[i]);
        let foreign: Vec<usize> = self.donors.iter().filter(|donor| is_foreign(donor)).map(|(j, _)| *j).collect();
        let of_own = |j: usize| {
            let (own, foreign) = (&m.inv_var[i * m.k..(i + 1) * m.k], &m.inv_var[j * m.k..(j + 1) * m.k]);
            own.iter().zip(foreign).map(|(own, foreign)| if *own > 0.0 { *foreign } else { 0.0 }).collect()
        };
        let foreign: Vec<(usize, Vec<f32>)> = spread(&foreign, FOREIGN).map(|j| (j, of_own(j))).collect();
        if foreign.len() < MIN_FOREIGN {
            return None;
        }
        let mut c = vec![0.0; m.k];
        spline.eval(at(refined.inv_z[i]), &mut c);
        let own = chi2_of_codeword(m, i, &c, prior);
        let mut best = vec![f32::INFINITY; foreign.len()];
        let depths = ((last - first) / step).ceil().max(1.0) as usize;
        for n in 0..=depths {
            let q = at(first + (last - first) * n as f32 / depths as f32);
            if !rays.is_calibrated(i, q, &field.validity) {
                continue;
            }
            spline.eval(q, &mut c);
            for (best, (j, inv_var)) in best.iter_mut().zip(&foreign) {
                *best = best.min(chi2_of_weighted(m, *j, inv_var, &c, prior));
            }
        }
        let least = best.iter().copied().fold(f32::INFINITY, f32::min);
        Some((
            best.iter().filter(|b| **b <= own).count() as f32 / best.len() as f32,
            least / own.max(f32::MIN_POSITIVE),
        ))
    }
}

/// Returns about `n` of some pixels, evenly spread over their list.
pub(super) fn spread(pixels: &[usize], n: usize) -> impl Iterator<Item = usize> + '_ {
    pixels.iter().copied().step_by(pixels.len().div_ceil(n).max(1))
}
