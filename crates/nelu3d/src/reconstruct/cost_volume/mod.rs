//! The start: a cost volume over the frozen color field, aggregated across neighbors.
//!
//! c is known, so E(t) = how badly c(x(t)) explains a pixel's codeword is known along every ray before anything is
//! optimized. Costs are in units of −2 log likelihood (χ²), and so are the penalties between neighbors: −2 log of the
//! prior probability of a step or a jump in depth. The minimum over all labels and neighbors is approached by
//! semi-global matching along eight directions (Hirschmüller 2008).
//!
//! The form here is the CPU's; `problem.rs` hands the same to other devices.

mod problem;

use nelu3d_field::cost_volume::{NEAR, OUTSIDE, Winner};
use nelu3d_field::device::Device;
use rayon::prelude::*;
use serde::Serialize;

use super::light_fractions::{LightFractionEquations, LightFractionPrior};
use crate::color_field::validity::Validity;
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Settings of the decoding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CostVolumeSettings {
    /// Most depth labels.
    pub max_hypotheses: usize,
    /// Prior probability that neighbors differ by a depth jump.
    pub p_jump: f32,
    /// Prior probability that neighbors differ by one label.
    pub p_step: f32,
}

/// A decoded image.
pub(super) struct DecodedDepth {
    /// Inverse depth 1/z per pixel, 1/mm; NaN where nothing was decoded.
    pub inv_z: Vec<f32>,
    /// How much worse (χ²) the best clearly different depth is, after aggregation.
    pub margin: Vec<f32>,
    /// The label spacing in 1/z.
    pub hypothesis_step: f32,
}

/// χ² is cut off here per pixel: beyond it a codeword is simply wrong (an outlier), however wrong.
pub(crate) fn saturation(m: &Measurements) -> f32 {
    9.0 * m.independent
}

/// Misfit (χ²) of pixel `i` at a point with codeword `c`, after the best shares of ambient light and interreflection,
/// saturating for outliers.
#[inline]
pub(crate) fn chi2_of_codeword(m: &Measurements, i: usize, c: &[f32], prior: [f32; 2]) -> f32 {
    let k = m.k;
    let (mut shares, mut e) = (LightFractionEquations::default(), 0.0);
    for j in 0..k {
        let (p, iv) = (m.p[i * k + j], m.inv_var[i * k + j]);
        shares.add(p - c[j], 1.0 - c[j], m.surround[i * k + j] - c[j], iv);
        e += iv * (p - c[j]) * (p - c[j]);
    }
    let e = (e - shares.solve(prior).1).max(0.0);
    e / (1.0 + e / saturation(m))
}

/// One set of labels for all pixels, even in 1/z, spaced so that no codeword changes by more than a fraction of a grid cell from
/// one label to the next.
pub(crate) struct DepthHypotheses {
    /// 1/z of the first, 1/mm.
    pub(crate) lo: f32,
    /// Their spacing, 1/mm.
    pub(crate) step: f32,
    /// How many there are.
    pub(crate) count: usize,
}

impl DepthHypotheses {
    /// 1/z of a label, 1/mm.
    fn inv_z(&self, label: usize) -> f32 {
        self.lo + label as f32 * self.step
    }

    /// For the kept pixels. Those whose rays miss the calibrated volume are marked [`PixelStatus::OutsideVolume`]; `None` if all do.
    pub(crate) fn new(
        m: &mut Measurements,
        rays: &CameraRays,
        grid: &SplineEvaluator<'_>,
        most: usize,
    ) -> Option<Self> {
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
        let kept: Vec<usize> = (0..m.n()).filter(|i| m.status[*i] == PixelStatus::Valid).collect();
        let count = label_count(&kept, rays, grid, lo, hi).clamp(16, most);
        Some(Self { lo, step: (hi - lo) / (count - 1) as f32, count })
    }
}

/// Decodes every kept pixel, on a device or, if it fails, on the CPU. Pixels whose rays miss the calibrated volume are
/// marked [`PixelStatus::OutsideVolume`].
pub(super) fn decode(
    m: &mut Measurements,
    rays: &CameraRays,
    grid: &SplineEvaluator<'_>,
    valid: &Validity,
    s: &CostVolumeSettings,
    prior: &LightFractionPrior,
    device: &Device,
) -> DecodedDepth {
    let n = m.n();
    let mut out = DecodedDepth { inv_z: vec![f32::NAN; n], margin: vec![0.0; n], hypothesis_step: 0.0 };
    let prior = prior.weights(m);
    let Some(labels) = DepthHypotheses::new(m, rays, grid, s.max_hypotheses) else {
        return out;
    };
    let kept: Vec<usize> = (0..n).filter(|i| m.status[*i] == PixelStatus::Valid).collect();
    let penalties = Penalties::new(s, labels.count);
    let found =
        (!device.is_cpu()).then(|| problem::solve(m, rays, grid, valid, prior, &labels, &penalties, &kept, device));
    let found = found.and_then(|found| {
        // A GPU that fails is no reason to have no result.
        found.inspect_err(|e| tracing::warn!("{e}; decoded on the CPU instead")).ok()
    });
    let found = found.unwrap_or_else(|| on_cpu(m, rays, grid, valid, prior, &labels, &penalties, &kept));
    out.hypothesis_step = labels.step;
    for (i, winner) in kept.into_iter().zip(found) {
        if winner.label.is_nan() {
            m.status[i] = PixelStatus::OutsideVolume;
            continue;
        }
        out.inv_z[i] = labels.lo + winner.label * labels.step;
        out.margin[i] = winner.margin;
    }
    out
}

/// χ² of neighbors that differ.
struct Penalties {
    /// By one label.
    step: f32,
    /// By more.
    jump: f32,
}

impl Penalties {
    fn new(s: &CostVolumeSettings, labels: usize) -> Self {
        Self { step: -2.0 * (s.p_step / (1.0 - 2.0 * s.p_step)).ln(), jump: -2.0 * (s.p_jump / labels as f32).ln() }
    }
}

/// The label of every kept pixel.
fn on_cpu(
    m: &Measurements,
    rays: &CameraRays,
    grid: &SplineEvaluator<'_>,
    valid: &Validity,
    prior: [f32; 2],
    all: &DepthHypotheses,
    penalties: &Penalties,
    kept: &[usize],
) -> Vec<Winner> {
    let labels = all.count;

    // Cost volume: f16 would do for the costs, but the sums of eight paths need the range of f32.
    let mut index = vec![u32::MAX; m.n()];
    for (slot, i) in kept.iter().enumerate() {
        index[*i] = slot as u32;
    }
    let mut cost = vec![0.0f32; kept.len() * labels];
    let k = m.k;
    let seen: Vec<bool> = cost
        .par_chunks_mut(labels)
        .zip(kept)
        .map_init(
            || vec![0.0; k],
            |c, (row, i)| {
                let [near, far] = rays.range[*i];
                let (ray, dir_z) = (rays.in_frame(*i), rays.dir_z(*i));
                let mut any = false;
                for (l, e) in row.iter_mut().enumerate() {
                    let t = 1.0 / (all.inv_z(l) * dir_z);
                    let q = ray.at(f64::from(t)).q;
                    *e = if t < near || t > far || !valid.is_lit(q) {
                        OUTSIDE
                    } else {
                        any = true;
                        grid.eval(q, c);
                        chi2_of_codeword(m, *i, c, prior)
                    };
                }
                any
            },
        )
        .collect();
    for (i, seen) in kept.iter().zip(&seen) {
        if !seen {
            index[*i] = u32::MAX;
        }
    }

    let mut total = vec![0.0f32; cost.len()];
    for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)] {
        aggregate(&cost, &mut total, &index, m.width, m.height, labels, (dx, dy), penalties.step, penalties.jump);
    }

    total
        .par_chunks(labels)
        .zip(cost.par_chunks(labels))
        .map(|(row, own)| {
            let best = (0..labels).min_by(|a, b| row[*a].total_cmp(&row[*b])).expect("there are labels");
            if own[best] >= OUTSIDE {
                return Winner::NONE;
            }
            let rival = (0..labels)
                .filter(|l| l.abs_diff(best) > NEAR)
                .map(|l| row[l])
                .min_by(f32::total_cmp)
                .unwrap_or(f32::INFINITY);
            let mut at = best as f32;
            if best > 0 && best + 1 < labels {
                let (a, b, c) = (row[best - 1], row[best], row[best + 1]);
                let bend = a - 2.0 * b + c;
                if bend > 1e-6 && a < OUTSIDE && c < OUTSIDE {
                    at += (0.5 * (a - c) / bend).clamp(-0.5, 0.5);
                }
            }
            Winner { label: at, margin: (rival - row[best]) / 8.0 }
        })
        .collect()
}

/// DepthHypotheses needed so that between two of them no ray moves by more than 0.7 of a pixel's width across (a, b).
fn label_count(kept: &[usize], rays: &CameraRays, grid: &SplineEvaluator<'_>, lo: f32, hi: f32) -> usize {
    let mut worst = 0.0f32;
    for i in kept.iter().step_by((kept.len() / 500).max(1)) {
        let at = |inv_z: f32| rays.in_frame(*i).at(f64::from(1.0 / (inv_z * rays.dir_z(*i)))).q;
        let (a, b) = (at(lo), at(hi));
        worst = worst.max(((a[0] - b[0]) * grid.pixels()[0]).hypot((a[1] - b[1]) * grid.pixels()[1]));
    }
    (worst / 0.7).ceil() as usize + 1
}

/// Standard deviation of a typical pixel's own depth, in labels (the median over pixels of what noise and slope of c
/// allow, averaged over depth).
pub(crate) fn depth_noise(m: &Measurements, rays: &CameraRays, grid: &SplineEvaluator<'_>) -> f32 {
    let kept: Vec<usize> = (0..m.n()).filter(|i| m.status[*i] == PixelStatus::Valid).collect();
    let k = m.k;
    let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
    let mut sigmas: Vec<f32> = kept
        .iter()
        .step_by((kept.len() / 2000).max(1))
        .filter(|i| rays.range[**i][0] < rays.range[**i][1])
        .map(|i| {
            let [near, far] = rays.range[*i];
            let mut information = 0.0;
            for step in 0..16 {
                let t = near + (far - near) * (step as f32 + 0.5) / 16.0;
                let p = rays.in_frame(*i).at(f64::from(t));
                grid.eval_along(p.q, p.dq, &mut c, &mut d);
                // A label moves 0.7 of a pixel across the grid.
                let speed = (p.dq[0] * grid.pixels()[0]).hypot(p.dq[1] * grid.pixels()[1]);
                let per_label = 0.7 / speed.max(1e-9);
                information += (0..k).map(|j| m.inv_var[i * k + j] * (d[j] * per_label).powi(2)).sum::<f32>() / 16.0;
            }
            1.0 / information.max(1e-12).sqrt()
        })
        .collect();
    if sigmas.is_empty() {
        return 1.0;
    }
    let mid = sigmas.len() / 2;
    *sigmas.select_nth_unstable_by(mid, f32::total_cmp).1
}

/// The smaller one. Unlike `f32::min`, which has to think of NaN, this is a single instruction.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The least of many values, in eight lanes.
fn least(v: &[f32]) -> f32 {
    let (chunks, rest) = v.as_chunks::<8>();
    let mut lanes = [f32::INFINITY; 8];
    for c in chunks {
        for l in 0..8 {
            lanes[l] = min(c[l], lanes[l]);
        }
    }
    rest.iter().chain(&lanes).fold(f32::INFINITY, |a, b| min(*b, a))
}

/// One direction of semi-global matching, added to `total`.
#[allow(clippy::too_many_arguments)]
fn aggregate(
    cost: &[f32],
    total: &mut [f32],
    index: &[u32],
    width: usize,
    height: usize,
    labels: usize,
    (dx, dy): (isize, isize),
    step: f32,
    jump: f32,
) {
    // Slots are in row order, so the pixels of one image row own one contiguous part of `total`.
    let slots_of = |y: usize| -> Option<(usize, usize)> {
        let row = &index[y * width..(y + 1) * width];
        let mut filled = row.iter().filter(|s| **s != u32::MAX);
        let first = *filled.next()? as usize;
        let last = filled.next_back().map_or(first, |s| *s as usize);
        Some((first, last + 1))
    };
    let advance = |own: &[f32], before: Option<&[f32]>, out: &mut [f32]| {
        let Some(before) = before else {
            out.copy_from_slice(own);
            return;
        };
        let least = least(before);
        let far = least + jump;
        let (before, own, out) = (&before[..labels], &own[..labels], &mut out[..labels]);
        let last = labels - 1;
        out[0] = own[0] + min(min(before[0], far), before[1] + step) - least;
        out[last] = own[last] + min(min(before[last], far), before[last - 1] + step) - least;
        // Slices of equal length and no branches: this loop runs as vectors.
        let (left, here, right) = (&before[..last - 1], &before[1..last], &before[2..]);
        for (((o, own), here), (l, r)) in
            out[1..last].iter_mut().zip(&own[1..last]).zip(here).zip(left.iter().zip(right))
        {
            *o = own + min(min(*here, far), min(*l, *r) + step) - least;
        }
    };
    if dy == 0 {
        // Rows are independent.
        let mut rest = total;
        let mut at = 0;
        let mut rows = Vec::new();
        for y in 0..height {
            if let Some((first, end)) = slots_of(y) {
                let (_, tail) = rest.split_at_mut((first - at) * labels);
                let (own, tail) = tail.split_at_mut((end - first) * labels);
                rows.push((y, first, own));
                rest = tail;
                at = end;
            }
        }
        rows.into_par_iter().for_each(|(y, first, sums)| {
            let (mut a, mut b) = (vec![0.0; labels], vec![0.0; labels]);
            let mut has = false;
            for i in 0..width {
                let x = if dx > 0 { i } else { width - 1 - i };
                let slot = index[y * width + x];
                if slot == u32::MAX {
                    has = false;
                    continue;
                }
                let slot = slot as usize;
                advance(&cost[slot * labels..(slot + 1) * labels], has.then_some(&a[..]), &mut b);
                let sum = &mut sums[(slot - first) * labels..][..labels];
                sum.iter_mut().zip(&b).for_each(|(s, v)| *s += v);
                std::mem::swap(&mut a, &mut b);
                has = true;
            }
        });
        return;
    }
    // Row after row; the pixels of a row are independent.
    let (mut before, mut now) = (Vec::<f32>::new(), Vec::<f32>::new());
    let mut before_first: Option<(usize, usize)> = None;
    for i in 0..height {
        let y = if dy > 0 { i } else { height - 1 - i };
        let Some((first, end)) = slots_of(y) else {
            before_first = None;
            continue;
        };
        now.resize((end - first) * labels, 0.0);
        let previous_y = y as isize - dy;
        let xs: Vec<usize> = (0..width).filter(|x| index[y * width + x] != u32::MAX).collect();
        now.par_chunks_mut(labels)
            .zip(total[first * labels..end * labels].par_chunks_mut(labels))
            .enumerate()
            .with_min_len(32)
            .for_each(|(j, (out, sum))| {
                let slot = first + j;
                // Slots of dropped pixels inside the row keep their place but take no part.
                let Ok(found) = xs.binary_search_by(|x| (index[y * width + x] as usize).cmp(&slot)) else { return };
                let px = xs[found] as isize - dx;
                let neighbor = match before_first {
                    Some((f, e)) if px >= 0 && (px as usize) < width => {
                        let s = index[previous_y as usize * width + px as usize];
                        (s != u32::MAX && (f..e).contains(&(s as usize)))
                            .then(|| &before[(s as usize - f) * labels..][..labels])
                    }
                    _ => None,
                };
                advance(&cost[slot * labels..(slot + 1) * labels], neighbor, out);
                sum.iter_mut().zip(out.iter()).for_each(|(s, v)| *s += v);
            });
        std::mem::swap(&mut before, &mut now);
        before_first = Some((first, end));
    }
}

#[cfg(test)]
mod tests;
