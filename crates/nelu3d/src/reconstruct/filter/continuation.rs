//! Components of a surface that are another one's continuation, at a wrong depth.
//!
//! Where a surface leaves the calibrated volume, or enters a gap of it, its next part is found at another period of the
//! code: a step in depth across which the measured codewords do not change. A true step shows other codewords behind
//! it. So the surface before a step is continued across it: if that explains what was measured there better than the
//! depth that was found, the step is none. Where nothing is known of the field there, since the surface leaves the
//! calibrated volume just at the step, what was found beyond has to fit about as well as the surface before it.

use nelu3d_scan::Camera;

use crate::reconstruct::cost_volume::chi2_of_codeword;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::pixel_beside::pixel_beside;
use crate::reconstruct::refine::Refined;
use crate::reconstruct::scene::Scene;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Pixels on each side of a step that may see both sides of it.
const MIXED_PX: isize = 2;
/// Largest gap between the two sides of a step, px.
const MAX_GAP_PX: isize = 3;
/// Pixels over which a surface's slope is taken.
const SLOPE_PX: isize = 8;
/// Depth hypotheses that a step has at least.
const MIN_STEP: f32 = 3.0;
/// Places along its outline that a component is judged by at least.
const MIN_PLACES: usize = 16;
/// χ² of the continued surface, as a part of that of the found one, below which the step is none.
const BETTER: f64 = 0.8;
/// Fraction of the places up to which the continued surface has left the calibrated volume.
const LEFT: f64 = 0.2;
/// χ² beyond such a step, as a multiple of that before it, above which the step is none.
const WORSE: f64 = 1.5;

/// How many times as many pixels a neighbor has beside which a component is a speck.
const MUCH_LARGER: usize = 20;
/// χ² of the continued neighbor of a speck, as a multiple of that of the found one, below which it explains the speck
/// about as well: of two such depths that of what is all around is the likelier one, and where few boards have been the
/// field is off by more than its noise. What truly stands before a wall shows codewords that are far from the wall's.
const AS_WELL: f64 = 2.5;

/// What a component's outline tells.
#[derive(Clone, Copy, Default)]
pub struct Outline {
    /// Number of places along it where a neighbor could be continued.
    pub places: usize,
    /// Sum of χ² at these places, at the depths that were found.
    pub found: f64,
    /// Sum of χ² at these places, at the depths where the neighbor is continued.
    pub continued: f64,
    /// Sum of χ² of the neighbor's own pixels across the step, at their depths.
    pub neighbor: f64,
    /// Number of places where the continued neighbor lies in the calibrated volume.
    pub inside: usize,
    /// Whether the neighbors at all these places are much larger than the component.
    pub is_speck: bool,
}

impl Outline {
    /// Returns why the component is rejected, if it is.
    pub fn rejection(&self) -> Option<PixelStatus> {
        let inside = self.inside as f64 / self.places.max(1) as f64;
        let is_continued = self.continued < if self.is_speck { AS_WELL } else { BETTER } * self.found;
        let begins_where_it_ends = inside < LEFT && self.found > WORSE * self.neighbor;
        let why = if inside > 0.5 { PixelStatus::Ambiguous } else { PixelStatus::OutsideVolume };
        (self.places >= MIN_PLACES && (is_continued || begins_where_it_ends)).then_some(why)
    }
}

/// Rejects the components of a depth map (camera z, mm) that a neighboring one, continued across the step between
/// them, explains better: as [`PixelStatus::OutsideVolume`] where it leaves the calibrated volume, else as
/// [`PixelStatus::Ambiguous`]. `step` is the spacing of the depth hypotheses in 1/z, 1/mm.
pub(super) fn reject_continuations(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    scene: &Scene<'_>,
    refined: &Refined,
    prior: &LightFractionPrior,
    step: f32,
    min_component: usize,
) {
    let Scene { camera, rays, field, measurements: m, .. } = scene;
    let (component, sizes) = Links::new(depth, camera, MAX_SLOPE).components(depth, camera.width);
    let prior = prior.weights(m);
    let spline = scene.spline();
    let mut outlines = vec![Outline::default(); sizes.len()];
    let mut c = vec![0.0; m.k];
    let mut chi2_at = |i: usize, inv_z: f32| {
        let [a, b, w] = rays.in_frame(i).at(f64::from(1.0 / (inv_z * rays.dir_z(i)))).q;
        let inside = rays.is_calibrated(i, [a, b, w], &field.validity);
        spline.eval([a, b, w.clamp(0.0, 1.0)], &mut c);
        (f64::from(chi2_of_codeword(m, i, &c, prior)), inside)
    };
    for (i, id) in component.iter().enumerate().filter(|(_, id)| **id != u32::MAX) {
        if (sizes[*id as usize] as usize) < min_component {
            continue;
        }
        for toward in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            let Some([across, further]) = behind_step(i, &component, &sizes, min_component, camera, toward) else {
                continue;
            };
            let inward = pixel_beside(i, toward, -MIXED_PX, camera).filter(|j| component[*j] == *id);
            let Some(j) = inward else { continue };
            let distance = pixels_between(j, across, camera) as f32;
            let slope = (refined.inv_z[across] - refined.inv_z[further]) / SLOPE_PX as f32;
            let continued = refined.inv_z[across] + slope * distance;
            if continued <= 0.0 || (continued - refined.inv_z[j]).abs() < MIN_STEP * step {
                continue;
            }
            let ((found, _), (continued, inside)) = (chi2_at(j, refined.inv_z[j]), chi2_at(j, continued));
            let (neighbor, _) = chi2_at(across, refined.inv_z[across]);
            let outline = &mut outlines[*id as usize];
            outline.places += 1;
            outline.found += found;
            outline.continued += continued;
            outline.neighbor += neighbor;
            outline.inside += usize::from(inside);
            let [own, beyond] = [*id, component[across]].map(|id| sizes[id as usize] as usize);
            outline.is_speck = (outline.places == 1 || outline.is_speck) && beyond > MUCH_LARGER * own;
        }
    }
    for (id, o) in outlines.iter().enumerate().filter(|(_, o)| o.places >= MIN_PLACES) {
        let per_place = 1.0 / (o.places as f64 * f64::from(m.independent));
        let [found, continued, neighbor] = [o.found, o.continued, o.neighbor].map(|sum| sum * per_place);
        tracing::debug!(
            pixels = sizes[id],
            places = o.places,
            found,
            continued,
            neighbor,
            inside = o.inside,
            "outline"
        );
    }
    for i in 0..depth.len() {
        if let Some(why) = outlines.get(component[i] as usize).and_then(Outline::rejection) {
            (depth[i], status[i]) = (f32::NAN, why);
        }
    }
}

/// Returns the number of pixels from one to another in its row or column.
pub fn pixels_between(i: usize, j: usize, camera: &Camera) -> usize {
    (i % camera.width).abs_diff(j % camera.width) + (i / camera.width).abs_diff(j / camera.width)
}

/// If pixel `i` is the last of its component in a direction, returns two pixels of the component behind the step: one
/// that sees that component alone, and one from which its slope can be told.
pub fn behind_step(
    i: usize,
    component: &[u32],
    sizes: &[u32],
    min_component: usize,
    camera: &Camera,
    toward: [isize; 2],
) -> Option<[usize; 2]> {
    let next = pixel_beside(i, toward, 1, camera)?;
    if component[next] == component[i] {
        return None;
    }
    let first = (1..=MAX_GAP_PX + 1)
        .filter_map(|by| pixel_beside(i, toward, by, camera))
        .find(|j| component[*j] != u32::MAX)?;
    let other = component[first];
    if other == component[i] || (sizes[other as usize] as usize) < min_component {
        return None;
    }
    let across = pixel_beside(first, toward, MIXED_PX, camera)?;
    let further = pixel_beside(across, toward, SLOPE_PX, camera)?;
    (component[across] == other && component[further] == other).then_some([across, further])
}
