//! Initialization from the previous frame's surface: a few depth hypotheses around it instead of the whole volume, and
//! the whole volume only where nothing near the previous surface explains what is measured now.

use nelu3d_scan::image::box_mean;
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::decoder::{Decoder, InitialDepth};
use crate::reconstruct::cost_volume::{chi2_of_codeword, depth_hypotheses, saturation};
use crate::reconstruct::maps::fill_from_neighbors;
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Returns the initial surface from that of the previous frame, `previous` (camera z per pixel, mm; NaN where there was
/// none), and the fraction of its pixels that were decoded in the whole volume all the same. `None` if the previous
/// surface says too little about this frame.
pub(super) fn start(decoder: &Decoder<'_>, previous: &[f32], m: &mut Measurements) -> Option<(InitialDepth, f32)> {
    let settings = decoder.settings;
    let max_hypotheses = settings.cost_volume.max_hypotheses;
    let step = depth_hypotheses(m, decoder.rays, decoder.spline, max_hypotheses)?.spacing;
    let propagated = propagate(decoder, m, previous, step);
    tracing::info!(wrong = propagated.wrong_fraction, "start from the previous frame");
    if propagated.wrong_fraction > settings.propagation.max_decoded {
        return None;
    }
    let mut inv_z = propagated.inv_z;
    if propagated.wrong.iter().any(|w| *w) {
        let mut part = m.clone();
        for (status, wrong) in part.status.iter_mut().zip(&propagated.wrong) {
            if *status == PixelStatus::Valid && !wrong {
                *status = PixelStatus::Underexposed;
            }
        }
        let found = decoder.decode(&mut part).inv_z;
        for i in (0..inv_z.len()).filter(|i| propagated.wrong[*i]) {
            if found[i].is_finite() || inv_z[i].is_nan() {
                inv_z[i] = found[i];
            }
            if part.status[i] == PixelStatus::OutsideVolume {
                m.status[i] = PixelStatus::OutsideVolume;
            }
        }
    }
    fill_from_neighbors(&mut inv_z, &m.status, m.width);
    Some((InitialDepth { inv_z, step }, propagated.wrong_fraction))
}

/// The previous surface, shifted to where it explains the new frame best.
struct Propagated {
    /// Inverse depth 1/z, 1/mm; NaN where there is none.
    inv_z: Vec<f32>,
    /// Pixels that need the whole volume.
    wrong: Vec<bool>,
    /// Fraction of all valid pixels that need the whole volume.
    wrong_fraction: f32,
}

/// Offset and χ² of the previous surface at each pixel.
struct Offsets {
    /// Best offset per pixel, depth hypotheses.
    offset: Vec<f32>,
    /// Mean χ² per measurement at that offset; infinite where the best offset is at an end of the range.
    chi2: Vec<f32>,
}

/// Shifts the previous surface by a smooth offset map. `step` is the spacing of depth hypotheses in 1/z, 1/mm.
fn propagate(decoder: &Decoder<'_>, m: &Measurements, previous: &[f32], step: f32) -> Propagated {
    let (w, h, n) = (m.width, m.height, m.n());
    let s = &decoder.settings.propagation;
    let mut near: Vec<f32> = previous.iter().map(|z| 1.0 / z).collect();
    fill_from_neighbors(&mut near, &m.status, w);
    let on: Vec<bool> = (0..n).map(|i| m.status[i] == PixelStatus::Valid && near[i].is_finite()).collect();
    let Offsets { offset, chi2 } = best_offsets(decoder, m, &near, &on, step);
    let mut all_chi2: Vec<f32> = (0..n).filter(|i| on[*i]).map(|i| chi2[i]).collect();
    let typical = median(&mut all_chi2).map_or(1.0, |middle| middle.max(1.0));
    // Beyond half of the saturation a codeword is simply wrong, whatever the others are.
    let limit = (s.max_chi2_ratio * typical).min(0.5 * saturation(m) / m.independent);
    // A pixel that is explained moves like those around it that are.
    let explained = |i: usize| on[i] && chi2[i] <= limit;
    let mut weight: Vec<f32> = (0..n).map(|i| if explained(i) { 1.0 } else { 0.0 }).collect();
    let mut sum: Vec<f32> = (0..n).map(|i| if explained(i) { offset[i] } else { 0.0 }).collect();
    for map in [&mut weight, &mut sum] {
        for _ in 0..2 {
            box_mean(map, w, h, s.smoothing_radius);
        }
    }
    let inv_z = (0..n)
        .map(|i| match on[i] {
            false => f32::NAN,
            true if weight[i] > 1e-3 => near[i] + step * sum[i] / weight[i],
            true => near[i] + step * offset[i],
        })
        .collect();
    let valid = |i: usize| m.status[i] == PixelStatus::Valid;
    let mut wide: Vec<f32> =
        (0..n).map(|i| if valid(i) && (near[i].is_nan() || chi2[i] > limit) { 1.0 } else { 0.0 }).collect();
    box_mean(&mut wide, w, h, s.margin);
    let wrong: Vec<bool> = (0..n).map(|i| valid(i) && wide[i] > 1e-4).collect();
    let n_valid = (0..n).filter(|i| valid(*i)).count().max(1);
    let wrong_fraction = wrong.iter().filter(|v| **v).count() as f32 / n_valid as f32;
    Propagated { inv_z, wrong, wrong_fraction }
}

/// Searches around the inverse depths `near`, 1/mm, at the pixels `on`, by the mean χ² over squares of every offset:
/// what moves together has one offset. Every second pixel of every second row tells: offsets are averaged over many
/// more.
fn best_offsets(decoder: &Decoder<'_>, m: &Measurements, near: &[f32], on: &[bool], step: f32) -> Offsets {
    let (w, h, n, k) = (m.width, m.height, m.n(), m.k);
    let s = &decoder.settings.propagation;
    let (rays, valid) = (decoder.rays, &decoder.field.validity);
    let prior = decoder.settings.light_fractions.weights(m);
    let radius = s.radius.max(decoder.noise_reduction(m));
    let tells = |i: usize| on[i] && (i % w).is_multiple_of(2) && (i / w).is_multiple_of(2);
    let mut count: Vec<f32> = (0..n).map(|i| if tells(i) { 1.0 } else { 0.0 }).collect();
    box_mean(&mut count, w, h, radius);
    let costs: Vec<Vec<f32>> = (-s.search_range..=s.search_range)
        .into_par_iter()
        .map(|offset| {
            let mut c = vec![0.0; k];
            let mut cost: Vec<f32> = (0..n)
                .map(|i| {
                    if !tells(i) {
                        return 0.0;
                    }
                    let t = 1.0 / ((near[i] + offset as f32 * step) * rays.dir_z(i));
                    let q = rays.in_frame(i).at(f64::from(t)).q;
                    let [close, far] = rays.range[i];
                    if !(t >= close && t <= far && rays.is_calibrated(i, q, valid)) {
                        return saturation(m);
                    }
                    decoder.spline.eval(q, &mut c);
                    chi2_of_codeword(m, i, &c, prior)
                })
                .collect();
            box_mean(&mut cost, w, h, radius);
            cost
        })
        .collect();
    let last = costs.len() - 1;
    let mut out = Offsets { offset: vec![0.0; n], chi2: vec![0.0; n] };
    for i in (0..n).filter(|i| on[*i]) {
        let at = |o: usize| costs[o][i];
        let best = (0..=last).min_by(|a, b| at(*a).total_cmp(&at(*b))).expect("there are offsets");
        let mut offset = best as f32 - s.search_range as f32;
        if best > 0 && best < last {
            let bend = at(best - 1) - 2.0 * at(best) + at(best + 1);
            if bend > 1e-6 {
                offset += (0.5 * (at(best - 1) - at(best + 1)) / bend).clamp(-0.5, 0.5);
            }
        }
        out.offset[i] = offset;
        // At either end the minimum may lie beyond; where no pixel of the square tells, it is at the first.
        out.chi2[i] = if best == 0 || best == last { f32::INFINITY } else { at(best) / count[i] / m.independent };
    }
    out
}
