//! What belongs to a surface outside the calibrated volume.
//!
//! A code repeats: a wall behind the volume shows some of the codewords that a surface within it would, and where an
//! object stands before the wall, smoothing puts these parts of the wall on the object's own plane. Nothing that they
//! show themselves tells them from it. What does is the rest of the wall, at whose sides they lie: light travels in
//! straight lines, so that the field, continued along its rays, explains all of the wall where it is. So the picture is
//! decoded once more, reduced, with depths before and behind the volume, and neighbors decide.

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::judgement::members;
use super::pieces::is_edge;
use super::settings::FilterSettings;
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::reconstruct::context::Context;
use crate::reconstruct::cost_volume::{CostVolumeSettings, chi2_of_codeword, decode};
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::pixel_beside::pixel_beside;
use crate::reconstruct::refine::Refined;
use crate::reconstruct::scene::Scene;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Distances that are tried: from this part of the nearest calibrated one to this multiple of the farthest.
const DISTANCES: [f32; 2] = [0.4, 4.0];
/// Most pixels that are decoded, and most of their channels.
const DECODED: [usize; 2] = [40_000, 400_000];
/// Hypotheses between two depths from which they are not the same.
const APART: f32 = 4.0;
/// χ² per measurement, after aggregation, by which all other depths have to be worse, in the median of a region: of
/// wrong ones it is 1 to 10, of right ones that are claimed 2.4 at most, where not their neighbors tell.
const MIN_MARGIN: f32 = 0.5;
/// χ² per measurement below which something outside explains a pixel: how focus changes there is not known.
const CLEAR_CHI2: f32 = 3.0;
/// Claimed fraction of a region between edges of brightness from which the rest of it goes along: a wall alone had 0.49,
/// a plate with strips of a wall on it between a quarter and 0.4.
const TAKES_REST: f32 = 0.4;

/// The picture, decoded in the field as it goes on before and behind the calibrated volume, in a reduced image.
pub(super) struct Continued {
    width: usize,
    height: usize,
    /// Side of its pixels, px of the picture.
    factor: usize,
    /// Inverse depth, 1/mm; NaN where there is none.
    inv_z: Vec<f32>,
    /// Spacing of the depths that were tried, 1/mm.
    step: f32,
    /// χ² per measurement there.
    chi2: Vec<f32>,
    /// χ² per measurement, after aggregation, by which every other depth is worse.
    margin: Vec<f32>,
}

impl Continued {
    /// Decodes the pixels that are lit; `None` where the light's place is not known.
    pub(super) fn decode(
        is_lit: impl Fn(usize) -> bool,
        scene: &Scene<'_>,
        prior: &LightFractionPrior,
        cx: &Context<'_>,
    ) -> Option<Self> {
        let some = scene.field.validity.t_range.iter().filter(|range| range[0] < range[1]);
        let [near, far] =
            some.fold([f32::INFINITY, 0.0f32], |[near, far], range| [near.min(range[0]), far.max(range[1])]);
        let field = scene.field.continued(&scene.grid, scene.camera, [DISTANCES[0] * near, DISTANCES[1] * far])?;
        let n = (0..scene.measurements.n()).filter(|i| is_lit(*i)).count();
        let most = DECODED[0].min(DECODED[1] / scene.measurements.k);
        let factor = (2..).find(|f| n / (f * f) <= most).expect("some reduction is enough");
        let mut m = scene.measurements.reduced_of(factor, is_lit);
        let is_valid = |i: usize| m.status[i] == PixelStatus::Valid;
        let rays = CameraRays::of_lit(scene.camera, &field, factor, scene.part.origin, is_valid);
        let grid = field.to_grid();
        let spline = SplineEvaluator::new(&grid, field.metadata.cells_per_pixel);
        let search = CostVolumeSettings { max_hypotheses: 512, p_jump: 0.01, p_step: 0.2 };
        let found = decode(&mut m, &rays, &spline, &field.validity, &search, prior, &cx.device, cx.progress);
        let weights = prior.weights(&m);
        let chi2_at = |i: usize| {
            let mut c = vec![0.0; m.k];
            spline.eval(rays.in_frame(i).at(f64::from(1.0 / (found.inv_z[i] * rays.dir_z(i)))).q, &mut c);
            chi2_of_codeword(&m, i, &c, weights) / m.independent_at(i)
        };
        let chi2 = |i: usize| if found.inv_z[i].is_finite() { chi2_at(i) } else { f32::INFINITY };
        Some(Self {
            width: m.width,
            height: m.height,
            factor,
            chi2: (0..m.n()).into_par_iter().map(chi2).collect(),
            margin: found.margin.iter().map(|margin| margin / m.independent).collect(),
            step: found.hypothesis_step,
            inv_z: found.inv_z,
        })
    }

    /// Returns the pixel of the reduced image that pixel `i` of the scene lies in, if that is explained outside of its
    /// calibrated range.
    fn outside(&self, i: usize, scene: &Scene<'_>) -> Option<usize> {
        let [x, y] = [i % scene.camera.width / self.factor, i / scene.camera.width / self.factor];
        let at = (x < self.width && y < self.height).then(|| y * self.width + x)?;
        let [near, far] = scene.rays.range[i];
        let distance = 1.0 / (self.inv_z[at] * scene.rays.dir_z(i));
        (distance.is_finite() && !(near..=far).contains(&distance)).then_some(at)
    }

    /// Returns whether something outside the calibrated volume explains a pixel of the scene about as well as noise
    /// lets it.
    pub(super) fn explains(&self, i: usize, scene: &Scene<'_>) -> bool {
        self.outside(i, scene).is_some_and(|at| self.chi2[at] < CLEAR_CHI2)
    }
}

/// Rejects the pixels of a depth map (camera z, mm; NaN: none) whose codewords, with those around them, belong before
/// or behind the calibrated volume, as [`PixelStatus::OutsideVolume`]: where much of the picture is explained nowhere
/// in it.
/// `continued` decodes the picture there.
pub(super) fn reject_outside<'a>(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    scene: &Scene<'_>,
    refined: &Refined,
    settings: &FilterSettings,
    continued: impl FnOnce() -> Option<&'a Continued>,
) {
    let lost = status.iter().filter(|s| matches!(s, PixelStatus::Ambiguous | PixelStatus::OutsideVolume)).count();
    let kept = depth.iter().filter(|z| z.is_finite()).count();
    if lost as f32 <= settings.in_pieces * (lost + kept) as f32 {
        return;
    }
    let Some(continued) = continued() else { return };
    let is_lit = |i: usize| status[i].is_measured();
    let claims = Claims::of(continued, depth, scene, refined);
    let outside = claims.granted(depth, is_lit, &scene.measurements.contrast, scene.camera);
    tracing::debug!(outside = outside.len(), kept, lost, "explained outside the volume, with what is around");
    for i in outside {
        (depth[i], status[i]) = (f32::NAN, PixelStatus::OutsideVolume);
    }
}

/// The pixels that something outside the calibrated volume explains, if neighbors have a say.
struct Claims {
    /// The depths that they were found at, mm; NaN at other pixels.
    depth: Vec<f32>,
    /// See [`Continued::margin`].
    margin: Vec<f32>,
}

impl Claims {
    fn of(continued: &Continued, depth: &[f32], scene: &Scene<'_>, refined: &Refined) -> Self {
        let mut claims = Self { depth: vec![f32::NAN; depth.len()], margin: vec![0.0; depth.len()] };
        for i in (0..depth.len()).filter(|i| depth[*i].is_finite() && scene.rays.known[*i].is_all()) {
            let Some(at) = continued.outside(i, scene) else { continue };
            if (continued.inv_z[at] - refined.inv_z[i]).abs() > APART * continued.step {
                (claims.depth[i], claims.margin[i]) = (depth[i], continued.margin[at]);
            }
        }
        claims
    }

    /// Returns the pixels of a depth map that lie outside: regions that are claimed with a clear margin, if they have no
    /// fewer lit neighbors without a depth than with one; and all that is connected, between edges of brightness, if
    /// much of it is claimed so. `light` is white − black.
    fn granted(&self, depth: &[f32], is_lit: impl Fn(usize) -> bool, light: &[f32], camera: &Camera) -> Vec<usize> {
        let (mut is_clear, mut is_outside) = (vec![false; depth.len()], vec![false; depth.len()]);
        let (region, sizes) = Links::new(&self.depth, camera, MAX_SLOPE).components(&self.depth, camera.width);
        for pixels in members(&region, &sizes) {
            let margin = median(&mut pixels.iter().map(|i| self.margin[*i]).collect::<Vec<f32>>());
            if margin.is_none_or(|margin| margin < MIN_MARGIN) {
                continue;
            }
            // Beside those whose neighbors in the volume are right, these have a depth.
            let (mut of_volume, mut of_outside) = (0, 0);
            for i in &pixels {
                is_clear[*i] = true;
                let at = |toward| pixel_beside(*i, toward, 1, camera);
                for j in
                    [[1, 0], [-1, 0], [0, 1], [0, -1]].into_iter().filter_map(at).filter(|j| self.depth[*j].is_nan())
                {
                    of_volume += usize::from(depth[j].is_finite());
                    of_outside += usize::from(depth[j].is_nan() && is_lit(j));
                }
            }
            if of_volume <= of_outside {
                pixels.iter().for_each(|i| is_outside[*i] = true);
            }
        }
        // Where the light of a surface leaves what was calibrated, the rest of it has no other explanation.
        let mut links = Links::new(depth, camera, MAX_SLOPE);
        links.cut(camera.width, |i, j| is_edge(light, depth, [i, j], camera.width));
        let (region, sizes) = links.components(depth, camera.width);
        for pixels in members(&region, &sizes) {
            let clear = pixels.iter().filter(|i| is_clear[**i]).count();
            if clear as f32 > TAKES_REST * pixels.len() as f32 {
                pixels.iter().for_each(|i| is_outside[*i] = true);
            }
        }
        (0..depth.len()).filter(|i| is_outside[*i]).collect()
    }
}
