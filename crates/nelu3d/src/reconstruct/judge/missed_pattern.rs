//! Whether an image of a scene shows another pattern than its own.

use super::along_rays::along_rays;
use super::odd_pattern::OddPattern;
use crate::reconstruct::scene::Scene;
use crate::sensor::{Measurements, PatternStatistics, edges, judge_patterns};
use crate::verdict::Finding;

/// Most pixels whose patterns are compared with each other.
const MAX_PIXELS: usize = 1500;
/// Lines of an image and of a field along which edges are counted.
const LINES: usize = 8;

/// Whether an image shows another pattern than its own: by what is measured alone, or by what of the lit pixels without
/// a depth is explained without it.
pub(in crate::reconstruct) fn disagreeing(scene: &Scene<'_>, has_depth: impl Fn(usize) -> bool) -> Option<Finding> {
    let (m, images) = (&scene.measurements, &scene.field.metadata.images);
    let is_seen = |i: usize| {
        let [near, far] = scene.rays.range[i];
        near < far && m.status[i].is_measured()
    };
    let seen: Vec<usize> = (0..m.n()).filter(|i| is_seen(*i)).collect();
    let pixels: Vec<usize> = seen.iter().copied().step_by(seen.len().div_ceil(MAX_PIXELS).max(1)).collect();
    let value = |j: usize| if m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN };
    let measured: Vec<f32> = pixels.iter().flat_map(|i| (i * m.k..(i + 1) * m.k).map(value)).collect();
    let of_scene = PatternStatistics::new(&measured, m.k);
    let of_field = PatternStatistics::new(&along_rays(scene, &pixels), m.k);
    judge_patterns((&of_scene, &edges_of_scene(m, is_seen)), (&of_field, &edges_of_field(scene)), images)
        .or_else(|| OddPattern::of(scene, has_depth).and_then(|odd| odd.judge(images)))
}

/// Mean number of edges of every channel along rows and along columns of an image, where they show much of what is seen.
fn edges_of_scene(m: &Measurements, is_seen: impl Fn(usize) -> bool) -> Vec<[f64; 2]> {
    let size = [m.width, m.height];
    let mut means = vec![[0.0; 2]; m.k];
    for way in 0..2 {
        let pixel = |line: usize, at: usize| if way == 0 { line * m.width + at } else { at * m.width + line };
        let seen = |line: &usize| (0..size[way]).filter(|at| is_seen(pixel(*line, *at))).count();
        let mut lines: Vec<(usize, usize)> =
            (0..size[1 - way]).map(|line| (seen(&line), line)).filter(|(seen, _)| *seen > 0).collect();
        lines.sort_unstable_by(|a, b| b.cmp(a));
        lines.truncate(lines.len().div_ceil(2));
        let step = lines.len().div_ceil(LINES).max(1);
        let chosen: Vec<usize> = lines.into_iter().step_by(step).map(|(_, line)| line).collect();
        for line in &chosen {
            let value = |i: usize| {
                let is_seen = is_seen(i);
                (i * m.k..(i + 1) * m.k).map(move |j| if is_seen && m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN })
            };
            let values: Vec<f32> = (0..size[way]).flat_map(|at| value(pixel(*line, at))).collect();
            let counts = edges(&values, m.k);
            means.iter_mut().zip(counts).for_each(|(mean, n)| mean[way] += f64::from(n) / chosen.len() as f64);
        }
    }
    means
}

/// Mean number of edges of every channel of the field along its two axes across the light, where it is calibrated: on
/// lines in the middle along the light.
fn edges_of_field(scene: &Scene<'_>) -> Vec<[f64; 2]> {
    let (k, valid) = (scene.measurements.k, &scene.field.validity);
    let mut means = vec![[0.0; 2]; k];
    let mut c = vec![0.0; k];
    for (axis, line) in (0..2).flat_map(|axis| (0..LINES).map(move |line| (axis, line))) {
        let beside = (line as f32 + 0.5) / LINES as f32;
        let n = scene.grid.cells[axis];
        let mut values = Vec::with_capacity(n * k);
        for i in 0..n {
            let at = (i as f32 + 0.5) / n as f32;
            let q = if axis == 0 { [at, beside, 0.5] } else { [beside, at, 0.5] };
            if valid.is_lit(q) {
                scene.grid.eval(q, &mut c);
            } else {
                c.fill(f32::NAN);
            }
            values.extend_from_slice(&c);
        }
        means.iter_mut().zip(edges(&values, k)).for_each(|(mean, n)| mean[axis] += f64::from(n) / LINES as f64);
    }
    means
}
