//! The start from the surface of the frame before: a few labels around it instead of the whole volume, and the whole volume only
//! where nothing near the old surface explains what is seen now.

use rayon::prelude::*;

use super::decode::{self, saturation};
use super::lookup::{Lookup, Rays};
use super::measure::{Measurements, SharesPrior};
use super::smooth::box_mean;
use crate::color_field::validity::Validity;
use crate::result::Left;

/// Labels looked at on either side of the old surface.
const REACH: i32 = 10;
/// Radius of the squares that move alike, px; larger where one pixel says little.
const RADIUS: usize = 2;
/// Radius over which the old surface moves as a whole, px: it keeps its shape, and the noise of one pixel's offset stays out of it.
const WHOLE: usize = 5;
/// Mean χ² per measurement above which the old surface is wrong, as a multiple of the typical one.
const WRONG: f32 = 3.0;
/// Radius by which wrong places are widened, px.
const MARGIN: usize = 4;

/// The old surface, moved to where it explains the new frame best.
pub(super) struct Moved {
    /// Inverse depth 1/z, 1/mm; NaN where there is none.
    pub(super) inv_z: Vec<f32>,
    /// Pixels that need the whole volume.
    pub(super) wrong: Vec<bool>,
    /// Their share of all kept pixels.
    pub(super) wrong_share: f32,
}

/// Looks around the old surface: `before` is its camera z (NaN where there was none), `unit` the label spacing in 1/z, `noisy` the side
/// of the squares whose codewords together tell depth to about a label.
#[allow(clippy::too_many_arguments)]
pub(super) fn moved(
    m: &Measurements,
    rays: &Rays,
    grid: &Lookup<'_>,
    valid: &Validity,
    before: &[f32],
    unit: f32,
    noisy: usize,
    shares: &SharesPrior,
) -> Moved {
    let (w, h, n, k) = (m.width, m.height, m.n(), m.k);
    let mut near: Vec<f32> = before.iter().map(|z| 1.0 / z).collect();
    super::fill(&mut near, &m.left, w);
    let on = |i: usize| m.left[i] == Left::Kept && near[i].is_finite();
    let prior = m.shares_prior(shares);
    let radius = RADIUS.max(noisy);
    let most = saturation(m);
    let mut count: Vec<f32> = (0..n).map(|i| if on(i) { 1.0 } else { 0.0 }).collect();
    box_mean(&mut count, w, h, radius);
    // Mean misfit over a square, of every offset from the old surface: what moves together has one offset.
    let costs: Vec<Vec<f32>> = (-REACH..=REACH)
        .into_par_iter()
        .map(|offset| {
            let mut c = vec![0.0; k];
            let mut cost: Vec<f32> = (0..n)
                .map(|i| {
                    if !on(i) {
                        return 0.0;
                    }
                    let t = 1.0 / ((near[i] + offset as f32 * unit) * rays.dir_z(i));
                    let q = rays.in_frame(i).at(f64::from(t)).q;
                    let [close, far] = rays.range[i];
                    if !(t >= close && t <= far && valid.is_lit(q)) {
                        return most;
                    }
                    grid.eval(q, &mut c);
                    decode::misfit(m, i, &c, prior)
                })
                .collect();
            box_mean(&mut cost, w, h, radius);
            cost
        })
        .collect();
    let last = costs.len() - 1;
    let (mut offsets, mut misfit) = (vec![0.0f32; n], vec![0.0f32; n]);
    for i in (0..n).filter(|i| on(*i)) {
        let at = |o: usize| costs[o][i];
        let best = (0..=last).min_by(|a, b| at(*a).total_cmp(&at(*b))).expect("there are offsets");
        let mut offset = best as f32 - REACH as f32;
        if best > 0 && best < last {
            let bend = at(best - 1) - 2.0 * at(best) + at(best + 1);
            if bend > 1e-6 {
                offset += (0.5 * (at(best - 1) - at(best + 1)) / bend).clamp(-0.5, 0.5);
            }
        }
        offsets[i] = offset;
        // At either end the minimum may lie beyond.
        misfit[i] = if best == 0 || best == last { f32::INFINITY } else { at(best) / count[i] / m.independent };
    }
    let typical = {
        let mut v: Vec<f32> = (0..n).filter(|i| on(*i)).map(|i| misfit[i]).collect();
        let mid = v.len() / 2;
        if v.is_empty() { 1.0 } else { v.select_nth_unstable_by(mid, f32::total_cmp).1.max(1.0) }
    };
    // Beyond half of the saturation a codeword is simply wrong, whatever the others are.
    let limit = (WRONG * typical).min(0.5 * most / m.independent);
    // What is right moves like what is right around it.
    let right = |i: usize| on(i) && misfit[i] <= limit;
    let mut weight: Vec<f32> = (0..n).map(|i| if right(i) { 1.0 } else { 0.0 }).collect();
    let mut sum: Vec<f32> = (0..n).map(|i| if right(i) { offsets[i] } else { 0.0 }).collect();
    for map in [&mut weight, &mut sum] {
        for _ in 0..2 {
            box_mean(map, w, h, WHOLE);
        }
    }
    let inv_z = (0..n)
        .map(|i| match on(i) {
            false => f32::NAN,
            true if weight[i] > 1e-3 => near[i] + unit * sum[i] / weight[i],
            true => near[i] + unit * offsets[i],
        })
        .collect();
    let mut wide: Vec<f32> = (0..n)
        .map(|i| {
            let kept = m.left[i] == Left::Kept;
            if kept && (near[i].is_nan() || misfit[i] > limit) { 1.0 } else { 0.0 }
        })
        .collect();
    box_mean(&mut wide, w, h, MARGIN);
    let wrong: Vec<bool> = (0..n).map(|i| m.left[i] == Left::Kept && wide[i] > 1e-4).collect();
    let kept = m.left.iter().filter(|l| **l == Left::Kept).count().max(1);
    let wrong_share = wrong.iter().filter(|v| **v).count() as f32 / kept as f32;
    Moved { inv_z, wrong, wrong_share }
}
