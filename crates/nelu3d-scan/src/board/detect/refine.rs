//! A corner from the edges that meet in it.

use nalgebra::{Matrix2x4, Matrix4, Vector2, Vector4};
use rayon::prelude::*;

use super::edge::{self, EdgeFit, Expected};
use super::light::Light;
use super::pixels::Pixels;
use super::spec::{Arm, CornerSpec};
use super::warp::Warp;
use crate::board::Corner;
use crate::statistics::median;

/// A corner, localized.
pub(super) struct Localized {
    pub(super) corner: Corner,
    /// Blur of its edges, px.
    blur: f64,
    /// Level of the white beside it.
    bright: f64,
}

/// Blur and light of an image, from an earlier pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conditions {
    /// Typical blur, px.
    blur: f64,
    light: Light,
}

/// Fraction of the clear strip beside an edge that is looked at: what lies beyond may be blurred into it.
const CLEAR_FRACTION: f64 = 0.6;
/// Fraction of the strip up to the board's outline that is looked at beside an edge: it may be dark beyond.
const OUTLINE_FRACTION: f64 = 0.45;
/// Strips narrower than this say nothing about levels, px on either side.
const MIN_HALF_WIDTH: f64 = 1.5;
/// Strip before the blur is known, px: wide enough to catch an edge that the coarse step misplaced.
const FIRST_HALF_WIDTH: f64 = 6.0;
/// More of an edge than this adds cost, not accuracy, px.
const MAX_LENGTH: f64 = 120.0;
/// Corners less certain than this (σ, px) are rejected.
const MAX_SIGMA: f64 = 0.2;
/// Corners less certain than this (σ, px) are rejected before the blur is known: strips then keep far from the corner,
/// and in noise the way back to it is uncertain. Such corners only place the strips of the next pass.
const FIRST_MAX_SIGMA: f64 = 1.0;

/// Localizes all corners whose edges are where the warp says, within the strips.
pub(super) fn corners(image: &Pixels, specs: &[CornerSpec], warp: &Warp, known: Option<&Conditions>) -> Vec<Localized> {
    specs.par_iter().filter_map(|spec| corner(image, spec, warp, known)).collect()
}

/// Returns blur and light of the image, from the corners of a pass.
pub(super) fn conditions(image: &Pixels, found: &[Localized]) -> Option<Conditions> {
    let levels: Vec<([f64; 2], f64)> = found.iter().map(|c| (c.corner.px, c.bright)).collect();
    Some(Conditions { blur: blur(found)?, light: Light::fit(image, &levels) })
}

/// Returns the median of the blur at corners, px.
pub(super) fn blur(found: &[Localized]) -> Option<f64> {
    median(&mut found.iter().map(|c| c.blur).collect::<Vec<f64>>())
}

fn corner(image: &Pixels, spec: &CornerSpec, warp: &Warp, known: Option<&Conditions>) -> Option<Localized> {
    let start = warp.px(spec.board_mm);
    let inside = start[0] >= 0.0 && start[1] >= 0.0 && start[0] < image.width as f64 && start[1] < image.height as f64;
    if !inside {
        return None;
    }
    // Unknown: the corner's shift, and the turn of each line. Each arm measures the shift along its normal, and its
    // turn.
    let (mut a, mut g) = (Matrix4::zeros(), Vector4::zeros());
    let mut blurs = Vec::with_capacity(4);
    let mut bright = 0.0f64;
    for (line, arms) in spec.lines.iter().enumerate() {
        for arm in arms {
            let (expected, fit) = measure(image, spec.board_mm, start, arm, warp, known)?;
            let n = expected.normal;
            let turn = (expected.along[0] * n[1] - expected.along[1] * n[0]).signum();
            let mut rows = Matrix2x4::zeros();
            (rows[(0, 0)], rows[(0, 1)]) = (n[0], n[1]);
            rows[(1, 2 + line)] = turn;
            a += rows.transpose() * fit.information * rows;
            g += rows.transpose() * fit.information * Vector2::new(fit.offset, fit.slope);
            blurs.push(fit.blur);
            bright = bright.max(fit.bright);
        }
    }
    let covariance = a.try_inverse()?;
    let shift = covariance * g;
    let sigma = covariance[(0, 0)].max(covariance[(1, 1)]).sqrt();
    let px = [start[0] + shift[0], start[1] + shift[1]];
    let most = if known.is_some() { MAX_SIGMA } else { FIRST_MAX_SIGMA };
    if !(sigma <= most && px.iter().all(|v| v.is_finite())) {
        return None;
    }
    Some(Localized { corner: Corner { board_mm: spec.board_mm, px }, blur: median(&mut blurs)?, bright })
}

/// Expects an arm where the warp puts it, and fits the edge there.
fn measure(
    image: &Pixels,
    board_mm: [f64; 2],
    start: [f64; 2],
    arm: &Arm,
    warp: &Warp,
    known: Option<&Conditions>,
) -> Option<(Expected, EdgeFit)> {
    let blur = known.map(|k| k.blur);
    let on_arm = |s: f64, d: f64| {
        let at = |k: usize| board_mm[k] + s * arm.dir[k] + d * arm.bright[k];
        warp.px([at(0), at(1)])
    };
    let mut reach = arm.length_mm;
    let mut end = on_arm(reach, 0.0);
    let mut length = (end[0] - start[0]).hypot(end[1] - start[1]);
    let mut ends = arm.ends;
    if length > MAX_LENGTH {
        reach *= MAX_LENGTH / length;
        end = on_arm(reach, 0.0);
        length = (end[0] - start[0]).hypot(end[1] - start[1]);
        ends = false;
    }
    let along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length];
    let middle = on_arm(0.5 * reach, 0.0);
    let side = on_arm(0.5 * reach, arm.clear_mm);
    let across = [side[0] - middle[0], side[1] - middle[1]];
    let turn = (along[0] * across[1] - along[1] * across[0]).signum();
    let normal = [-along[1] * turn, along[0] * turn];
    // The clear strip as wide as it is seen, measured across the edge.
    let clear = across[0] * normal[0] + across[1] * normal[1];
    let sag = (0..2).map(|k| (middle[k] - 0.5 * (start[k] + end[k])) * normal[k]).sum();
    let slope = known.map_or([0.0; 2], |k| k.light.slope(middle));
    let light = slope[0] * normal[0] + slope[1] * normal[1];
    let wanted = blur.map_or(FIRST_HALF_WIDTH, |b| (3.5 * b + 1.0).clamp(2.5, 20.0));
    // Where the clear strip is narrow, what bounds it is looked at, too, if it is known.
    let next = (arm.has_marker && wanted > CLEAR_FRACTION * clear).then_some(clear);
    let expected = Expected { start, along, normal, length, sag, light, next };
    // Beyond the outline is whatever there is.
    let outline = (OUTLINE_FRACTION * clear * arm.outline_mm / arm.clear_mm).max(MIN_HALF_WIDTH);
    let half_width = wanted.min(if next.is_some() { clear } else { CLEAR_FRACTION * clear }).min(outline);
    // Around the corner the other edge rounds this one off, by as much as it is blurred; a marker begins there.
    let skip = blur.map_or(0.4 * length, |b| 3.0 * b + 0.7).min(0.4 * length).max(1.5).max(next.unwrap_or(0.0));
    let range = [skip, if ends { length - skip } else { length }];
    if !(half_width >= MIN_HALF_WIDTH && range[1] - range[0] >= 2.0) {
        return None;
    }
    Some((expected, edge::fit(image, &expected, range, half_width, blur)?))
}
