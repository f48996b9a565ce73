//! Means around pixels that leave out what is nearer to an edge of the surface.

use nelu3d_scan::image::box_mean;

/// Distances from edges of the surface (half the sides of squares that have none) at which zones begin, px.
const BEGIN: [usize; 3] = [0, 3, 8];
/// Part of a square that has to lie in a pixel's zone or farther in. Where less does, the next zone outward is counted.
const MIN_PART: f32 = 0.1;

/// The zones of a surface by distance from its edges. At a silhouette surfaces bend out of sight and see light that is
/// mixed with what is behind, so that errors there tell nothing of what lies farther in.
pub(super) struct Zones {
    size: [usize; 2],
    radius: usize,
    /// Per zone: which pixels are in it or farther in, and the part of the square around every pixel that is.
    within: Vec<(Vec<bool>, Vec<f32>)>,
    /// Zone whose means a pixel takes; one beyond the last outside of the surface.
    zone: Vec<usize>,
}

impl Zones {
    /// Finds the zones of a surface of some width and height, for means over squares of the given radius, px.
    pub(super) fn new(active: &[bool], [w, h]: [usize; 2], radius: usize) -> Self {
        let map = |mask: &[bool]| mask.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect::<Vec<f32>>();
        let within: Vec<_> = BEGIN
            .into_iter()
            .map(|begin| {
                let mut free = map(active);
                box_mean(&mut free, w, h, begin);
                let mask: Vec<bool> = free.iter().zip(active).map(|(free, a)| *a && *free > 0.999).collect();
                let mut part = map(&mask);
                box_mean(&mut part, w, h, radius);
                (mask, part)
            })
            .collect();
        let zone_of = |i: usize| match within.iter().rposition(|(mask, part)| mask[i] && part[i] >= MIN_PART) {
            Some(zone) => zone,
            None if active[i] => 0,
            None => BEGIN.len(),
        };
        let zone = (0..active.len()).map(zone_of).collect();
        Self { size: [w, h], radius, within, zone }
    }

    /// Returns which pixels lie in the innermost zone.
    pub(super) fn innermost(&self) -> &[bool] {
        &self.within[BEGIN.len() - 1].0
    }

    /// Returns whether a pixel is in no zone but the outermost.
    pub(super) fn is_outermost(&self, i: usize) -> bool {
        !self.within[1].0[i]
    }

    /// Returns the mean of a map around every pixel of the surface, over those of the square that are no nearer to an
    /// edge than its zone; 0 outside of the surface.
    pub(super) fn mean(&self, v: &[f32]) -> Vec<f32> {
        self.mean_at(v, |_| true)
    }

    /// Returns the means of [`Self::mean`] at the pixels that are `wanted`, and any or 0 at others.
    pub(super) fn mean_at(&self, v: &[f32], wanted: impl Fn(usize) -> bool) -> Vec<f32> {
        let mut out = vec![0.0; v.len()];
        for (zone, (mask, part)) in self.within.iter().enumerate() {
            if !(0..v.len()).any(|i| self.zone[i] == zone && wanted(i)) {
                continue;
            }
            let mut mean: Vec<f32> = v.iter().zip(mask).map(|(v, is_in)| if *is_in { *v } else { 0.0 }).collect();
            box_mean(&mut mean, self.size[0], self.size[1], self.radius);
            for i in (0..v.len()).filter(|i| self.zone[*i] == zone && part[*i] > 0.0) {
                out[i] = mean[i] / part[i];
            }
        }
        out
    }
}
