//! Whether a component's codewords belong to points outside the calibrated volume.
//!
//! A field is calibrated on part of each camera ray: in gaps that no board has crossed, and before and behind all
//! boards, nothing vouches for it. A surface there is not found; what is found instead is the best of the calibrated
//! depths, a wrong period of the code. But light travels in straight lines, so that the field tells what codewords
//! there are on the rest of a ray, too, well enough to see that the own one is among them.

use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::chance::{MARGIN, spread};
use crate::reconstruct::cost_volume::chi2_of_codeword;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::refine::Refined;
use crate::reconstruct::scene::Scene;

/// Number of pixels of a component that are tested.
const TESTED: usize = 64;
/// Points are tried from infinity to this fraction of the nearest calibrated depth.
const NEAREST: f32 = 0.5;
/// Largest number of points of a ray.
const MAX_POINTS: usize = 8192;
/// Part of the own χ² below which another explanation is far better.
const BETTER: f32 = 0.5;
/// χ² per measurement below which no other explanation is needed.
const NEEDS_NONE: f32 = 1.0;

/// What the rest of one pixel's ray explains.
struct OfPixel {
    /// Whether some point outside the calibrated volume is a far better explanation.
    is_beyond: bool,
    /// Number of depths outside the calibrated volume over that of those inside.
    depths: f32,
}

/// Returns the fraction of the pixels of a component that some point on their rays outside the calibrated volume
/// explains far better than the found depth, less the fraction that chance gives. `chance` is the fraction of foreign
/// codewords that the calibrated depths explain, `step` the spacing of the depths that are tried in 1/z, 1/mm.
pub(super) fn explained_beyond(
    pixels: &[usize],
    scene: &Scene<'_>,
    refined: &Refined,
    prior: &LightFractionPrior,
    step: f32,
    chance: f32,
) -> f32 {
    let prior = prior.weights(&scene.measurements);
    let tested: Vec<usize> = spread(pixels, TESTED).collect();
    let of_pixels: Vec<OfPixel> = tested.par_iter().map(|i| test(*i, scene, refined, prior, step)).collect();
    let found = of_pixels.iter().filter(|p| p.is_beyond).count() as f32 / of_pixels.len().max(1) as f32;
    let depths = median(&mut of_pixels.iter().map(|p| p.depths).collect::<Vec<f32>>()).unwrap_or(0.0);
    found - (1.0 - (1.0 - chance).powf(depths))
}

/// The test of one pixel.
fn test(i: usize, scene: &Scene<'_>, refined: &Refined, prior: [f32; 2], step: f32) -> OfPixel {
    let Scene { rays, field, measurements: m, .. } = scene;
    let spline = scene.spline();
    let (ray, dir_z) = (rays.in_frame(i), rays.dir_z(i));
    let at = |inv_z: f32| ray.at(f64::from(1.0 / (inv_z * dir_z))).q;
    let mut c = vec![0.0; m.k];
    let mut chi2_at = |[a, b, w]: [f32; 3]| {
        // How focus changes beyond the volume is not known.
        spline.eval([a, b, w.clamp(0.0, 1.0)], &mut c);
        chi2_of_codeword(m, i, &c, prior)
    };
    let found = at(refined.inv_z[i]);
    let own = chi2_at(found);
    let is_elsewhere = |q: &[f32; 3]| {
        let in_light = q[..2].iter().all(|v| (0.0..=1.0).contains(v));
        in_light && (q[0] - found[0]).hypot(q[1] - found[1]) > MARGIN
    };
    let last = 1.0 / (NEAREST * rays.range[i][0] * dir_z);
    let points = (1..=((last / step) as usize).min(MAX_POINTS)).map(|n| at(n as f32 * step)).filter(is_elsewhere);
    let (inside, outside): (Vec<[f32; 3]>, Vec<[f32; 3]>) =
        points.partition(|q| rays.is_calibrated(i, *q, &field.validity));
    let needs_other = own > NEEDS_NONE * m.independent;
    OfPixel {
        is_beyond: needs_other && outside.iter().any(|q| chi2_at(*q) < BETTER * own),
        depths: outside.len() as f32 / inside.len().max(1) as f32,
    }
}
