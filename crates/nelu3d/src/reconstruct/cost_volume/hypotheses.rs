//! The depth hypotheses of an image, and how well single pixels tell depth.

use nelu3d_field::cost_volume::DepthHypotheses;
use nelu3d_scan::statistics::median;

use crate::color_field::{CameraRays, SplineEvaluator};
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Largest shift across (a, b) from one depth hypothesis to the next, pixels: the unit of depth of the refinement.
pub(crate) const HYPOTHESIS_PX: f32 = 0.7;

/// Returns one set of depth hypotheses for all valid pixels, even in 1/z (1/mm), spaced so that no codeword changes by
/// more than a fraction of a grid cell from one to the next. Pixels whose rays miss the calibrated volume are marked
/// [`PixelStatus::OutsideVolume`]; `None` if all do.
pub fn depth_hypotheses(
    m: &mut Measurements,
    rays: &CameraRays,
    grid: &SplineEvaluator<'_>,
    max_count: usize,
) -> Option<DepthHypotheses> {
    let (mut lo, mut hi) = (f32::INFINITY, 0.0f32);
    for i in 0..m.n() {
        if m.status[i] != PixelStatus::Valid {
            continue;
        }
        let [near, far] = rays.range[i];
        if near > far {
            m.status[i] = PixelStatus::OutsideVolume;
            continue;
        }
        lo = lo.min(1.0 / (far * rays.dir_z(i)));
        hi = hi.max(1.0 / (near * rays.dir_z(i)));
    }
    if lo >= hi {
        return None;
    }
    let valid: Vec<usize> = (0..m.n()).filter(|i| m.status[*i] == PixelStatus::Valid).collect();
    let count = hypothesis_count(&valid, rays, grid, lo, hi).clamp(16, max_count);
    Some(DepthHypotheses { first: lo, spacing: (hi - lo) / (count - 1) as f32, count })
}

/// Returns the number of hypotheses for which no ray's point shifts by more than 0.7 of a pixel's width across (a, b)
/// from one to the next.
fn hypothesis_count(valid: &[usize], rays: &CameraRays, grid: &SplineEvaluator<'_>, lo: f32, hi: f32) -> usize {
    let mut longest = 0.0f32;
    for i in valid.iter().step_by((valid.len() / 500).max(1)) {
        let at = |inv_z: f32| rays.in_frame(*i).at(f64::from(1.0 / (inv_z * rays.dir_z(*i)))).q;
        let (a, b) = (at(lo), at(hi));
        longest = longest.max(((a[0] - b[0]) * grid.pixels()[0]).hypot((a[1] - b[1]) * grid.pixels()[1]));
    }
    (longest / HYPOTHESIS_PX).ceil() as usize + 1
}

/// Returns the standard deviation of a typical pixel's own depth, in hypotheses: the median over pixels of what noise
/// and slope of c allow, averaged over depth.
pub(crate) fn depth_noise(m: &Measurements, rays: &CameraRays, grid: &SplineEvaluator<'_>) -> f32 {
    let valid: Vec<usize> = (0..m.n()).filter(|i| m.status[*i] == PixelStatus::Valid).collect();
    let k = m.k;
    let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
    let mut sigmas: Vec<f32> = valid
        .iter()
        .step_by((valid.len() / 2000).max(1))
        .filter(|i| rays.range[**i][0] < rays.range[**i][1])
        .map(|i| {
            let [near, far] = rays.range[*i];
            let mut information = 0.0;
            for step in 0..16 {
                let t = near + (far - near) * (step as f32 + 0.5) / 16.0;
                let p = rays.in_frame(*i).at(f64::from(t));
                grid.eval_along(p.q, p.dq, &mut c, &mut d);
                let speed = (p.dq[0] * grid.pixels()[0]).hypot(p.dq[1] * grid.pixels()[1]);
                let per_hypothesis = HYPOTHESIS_PX / speed.max(1e-9);
                information +=
                    (0..k).map(|j| m.inv_var[i * k + j] * (d[j] * per_hypothesis).powi(2)).sum::<f32>() / 16.0;
            }
            1.0 / information.max(1e-12).sqrt()
        })
        .collect();
    median(&mut sigmas).unwrap_or(1.0)
}
