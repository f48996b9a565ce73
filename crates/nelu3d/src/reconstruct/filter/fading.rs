//! Regions of a surface whose outlines fade: they end where nothing does.
//!
//! A surface ends at an edge: what is seen beside it has a codeword of its own, which the surface, continued, does not
//! explain at all. A piece of a wall behind the calibrated volume that is explained by chance ends in the middle of
//! that wall: continued, it explains what is beside it nearly, and worse from pixel to pixel. How badly codewords of the
//! same picture that do not belong there are explained is tried, as for whole components: codes of few patterns explain
//! much.
//!
//! Right surfaces have such outlines, too, where interreflection takes their rims, or where they leave the calibrated
//! volume. So a region is only rejected for them if chance explains it as often, or if it fits much worse than what
//! ends at edges, which the picture has to have then.
//!
//! A region that chance explains many times over, among the pixels without a depth, has to have a χ² per measurement
//! about as small as that of regions that it does not explain, whatever the region ends at.

use std::cmp::Reverse;

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;

use super::judgement::{members, weighted_median};
use super::pieces::is_edge;
use super::settings::FilterSettings;
use crate::reconstruct::cost_volume::chi2_of_codeword;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::pixel_beside::pixel_beside;
use crate::reconstruct::refine::Refined;
use crate::reconstruct::scene::Scene;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Pixels beyond an outline at which the surface is continued, and over which its slope is taken: further than mixed
/// pixels and lost rims reach.
const BEYOND_PX: isize = 4;
/// Number of foreign codewords with which that of a place is compared.
const FOREIGN: usize = 4;
/// Places along its outline that tell about a region, as a multiple of the root of its size: of a square, a quarter of
/// its outline and more.
const MIN_PLACES: f64 = 1.2;
/// χ² per measurement of the continued surface that an edge exceeds at more than a quarter of its places.
const EDGE_CHI2: f32 = 6.5;
/// Fraction of the foreign codewords that are explained worse, from which an outline fades, and from which a region may
/// be rejected for it. At edges it is a half on average.
const FADES: [f64; 2] = [0.8, 0.9];
/// Times that chance explains as many pixels as a region has above which it is rejected where other regions end at
/// edges; above which it is not supported; and above which it is rejected whatever the others do.
const MAX_TRIES: [f32; 3] = [2.0, 3.0, 15.0];
/// χ² of a region as a multiple of what is typical of those that end at edges above which it is rejected.
const MAX_OVER_TYPICAL: f32 = 2.0;
/// χ² of a region that chance explains that often whatever it ends at, as a multiple of what is typical of those that
/// are supported, above which it is rejected.
const MAX_OVER_SUPPORTED: f32 = 1.4;
/// Most regions that are looked at, the largest: a texture has thousands, and chance takes milliseconds to try.
const MAX_REGIONS: usize = 200;
/// Fraction of the pixels that has to end at edges for a region to be rejected.
const MIN_AT_EDGES: f64 = 0.25;

/// What the outline of a region tells.
#[derive(Clone, Debug, Default)]
pub struct Outline {
    /// χ² per measurement of the surface, continued to beyond each place.
    pub chi2: Vec<f32>,
    /// Number of foreign codewords that the continued surface explains worse.
    pub worse: usize,
}

impl Outline {
    /// Returns the fraction of foreign codewords that are explained worse than what is beside a region of `size`
    /// pixels, if its outline fades.
    pub fn fades(&self, size: usize) -> Option<f64> {
        let places = self.chi2.len();
        let clear = self.chi2.iter().filter(|chi2| **chi2 > EDGE_CHI2).count();
        let worse = self.worse as f64 / (FOREIGN * places.max(1)) as f64;
        let tells = places as f64 > MIN_PLACES * (size as f64).sqrt();
        (tells && 4 * clear <= places && worse > FADES[0]).then_some(worse)
    }
}

/// What is known of a region of a surface between its outlines and edges of brightness.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// Number of its pixels.
    pub size: usize,
    /// See [`Outline::fades`].
    pub fades: Option<f64>,
    /// Median χ² per measurement.
    pub chi2: f32,
    /// How often chance explains as many pixels, of all that have no depth.
    pub tries: f32,
}

impl Region {
    /// Returns whether its outline fades enough for it to be rejected.
    fn fades_away(&self) -> bool {
        self.fades.is_some_and(|worse| worse > FADES[1])
    }
}

/// Returns which regions of a picture are rejected.
pub fn rejected(regions: &[Region]) -> Vec<bool> {
    let typical = |of: &dyn Fn(&Region) -> bool, times: f32| {
        let those = regions.iter().filter(|r| of(r)).map(|r| (r.chi2, r.size));
        weighted_median(those.collect()).map_or(f32::INFINITY, |typical| times * typical)
    };
    let at_edges = size_of(regions, |r| !r.fades_away()) / size_of(regions, |_| true).max(1.0);
    let max_chi2 = typical(&|r| !r.fades_away(), MAX_OVER_TYPICAL);
    let supported = typical(&|r| r.tries <= MAX_TRIES[1], MAX_OVER_SUPPORTED);
    let is_rejected = |r: &Region| {
        let is_odd = r.tries > MAX_TRIES[0] || r.chi2 > max_chi2;
        let is_chance = r.tries > MAX_TRIES[2] && (r.fades_away() || r.chi2 > supported);
        is_chance || (r.fades_away() && at_edges > MIN_AT_EDGES && is_odd)
    };
    regions.iter().map(is_rejected).collect()
}

/// Returns the number of pixels of those regions for which `of` holds.
fn size_of(regions: &[Region], of: impl Fn(&Region) -> bool) -> f64 {
    regions.iter().filter(|r| of(r)).map(|r| r.size).sum::<usize>() as f64
}

/// Rejects the regions of a depth map (camera z, mm; NaN: none) that fade, as [`PixelStatus::Ambiguous`], and returns
/// which pixels of those that are left nothing but their own fit supports: they fade, too, or chance explains as many
/// of what is explained nowhere. `None` where the captures do not tell: nearly all is explained, or χ² is not one of
/// noise. `by_chance` tells which fraction of foreign codewords is explained as well as those of some pixels,
/// `is_elsewhere` whether a pixel is explained outside the volume.
pub(super) fn reject_fading(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    scene: &Scene<'_>,
    refined: &Refined,
    prior: &LightFractionPrior,
    settings: &FilterSettings,
    (by_chance, is_elsewhere): (impl Fn(&[usize]) -> Option<f32>, impl Fn(usize) -> bool),
) -> Option<Vec<bool>> {
    let lost: Vec<usize> = (0..depth.len()).filter(|i| depth[*i].is_nan() && is_lit(status[*i])).collect();
    let kept = depth.iter().filter(|z| z.is_finite()).count();
    let much_is_lost = lost.len() as f32 > settings.in_pieces * (lost.len() + kept) as f32;
    if !(scene.field.metadata.is_at_its_noise() && much_is_lost) {
        return None;
    }
    let (camera, light) = (scene.camera, &scene.measurements.contrast);
    let mut links = Links::new(depth, camera, MAX_SLOPE);
    links.cut(camera.width, |i, j| is_edge(light, depth, [i, j], camera.width));
    let (region, sizes) = links.components(depth, camera.width);
    let outlines = outlines(&region, sizes.len(), &lost, scene, refined, prior);
    let mut regions: Vec<(Vec<usize>, Outline)> = members(&region, &sizes).into_iter().zip(outlines).collect();
    regions.retain(|(pixels, _)| pixels.len() >= settings.min_component);
    regions.sort_by_key(|(pixels, _)| Reverse(pixels.len()));
    regions.truncate(MAX_REGIONS);
    let known: Vec<Region> = regions
        .iter()
        .map(|(pixels, outline)| {
            let chance = by_chance(pixels).unwrap_or(settings.unknown_chance);
            let chi2 = median(&mut pixels.iter().map(|i| refined.chi2[*i]).collect::<Vec<f32>>());
            let (size, tries) = (pixels.len(), chance * lost.len() as f32 / pixels.len() as f32);
            Region { size, fades: outline.fades(size), chi2: chi2.unwrap_or(f32::INFINITY), tries }
        })
        .collect();
    let nowhere = lost.iter().filter(|i| !is_elsewhere(**i)).count() as f32 / lost.len() as f32;
    let mut is_unsupported = vec![false; depth.len()];
    for (((pixels, _), region), rejected) in regions.iter().zip(&known).zip(rejected(&known)) {
        tracing::debug!(?region, rejected, nowhere, "region");
        for &i in pixels {
            if rejected {
                (depth[i], status[i]) = (f32::NAN, PixelStatus::Ambiguous);
            }
            is_unsupported[i] = region.fades.is_some() || region.tries * nowhere > MAX_TRIES[1];
        }
    }
    Some(is_unsupported)
}

/// Whether a pixel without depth is lit and within the camera rays of the calibrated volume.
fn is_lit(status: PixelStatus) -> bool {
    matches!(status, PixelStatus::Ambiguous | PixelStatus::OutsideVolume | PixelStatus::DepthDiscontinuity)
}

/// Continues each of `n` regions across its outline to lit pixels without a depth, `lost`, as far as the field is
/// known there.
fn outlines(
    region: &[u32],
    n: usize,
    lost: &[usize],
    scene: &Scene<'_>,
    refined: &Refined,
    prior: &LightFractionPrior,
) -> Vec<Outline> {
    let Scene { rays, field, measurements: m, .. } = scene;
    let camera: &Camera = scene.camera;
    let mut is_lost = vec![false; region.len()];
    lost.iter().for_each(|i| is_lost[*i] = true);
    let (prior, spline) = (prior.weights(m), scene.spline());
    let mut c = vec![0.0; m.k];
    let mut outlines = vec![Outline::default(); n];
    let mut tried = 0;
    for i in (0..region.len()).filter(|i| region[*i] != u32::MAX) {
        for toward in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            let at = |by: isize| pixel_beside(i, toward, by, camera);
            let Some(behind) = at(-BEYOND_PX).filter(|j| region[*j] == region[i]) else { continue };
            let beyond = (1..=BEYOND_PX).map(at).try_fold(i, |_, j| j.filter(|j| is_lost[*j]));
            // In 1/z, in which a plane is straight.
            let inv_z = 2.0 * refined.inv_z[i] - refined.inv_z[behind];
            let Some(beyond) = beyond.filter(|_| inv_z > 0.0) else { continue };
            let q = rays.in_frame(beyond).at(f64::from(1.0 / (inv_z * rays.dir_z(beyond)))).q;
            if !rays.is_calibrated(beyond, q, &field.validity) {
                continue;
            }
            spline.eval(q, &mut c);
            let own = chi2_of_codeword(m, beyond, &c, prior);
            let outline = &mut outlines[region[i] as usize];
            outline.chi2.push(own / m.independent);
            for _ in 0..FOREIGN {
                tried += 1;
                // All over the picture, in an order that no pattern has.
                let foreign = lost[(tried * 0x9E37_79B1) % lost.len()];
                outline.worse += usize::from(chi2_of_codeword(m, foreign, &c, prior) > own);
            }
        }
    }
    outlines
}
