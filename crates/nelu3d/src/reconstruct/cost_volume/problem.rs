//! The decoding as a problem that [`nelu3d_field::cost_volume`] solves on a device.

use nelu3d_field::cost_volume::{self, Lit, Problem, Ray, Winner};
use nelu3d_field::device::{Device, DeviceError};
use rayon::prelude::*;

use super::{DepthHypotheses, Penalties, saturation};
use crate::color_field::validity::Validity;
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::sensor::Measurements;

/// The labels of pixel `i` in the field. They are even in v = 1/z and t = 1/(v · dir_z), so that v · h(t) is linear in v.
fn ray(i: usize, rays: &CameraRays, labels: &DepthHypotheses) -> Ray {
    let dir_z = rays.dir_z(i);
    let [near, far] = rays.range[i];
    // Farther labels have smaller numbers; the comparisons are those of the CPU's form.
    let t = |l: usize| 1.0 / (labels.inv_z(l) * dir_z);
    let first = partition_point(labels.count, |l| t(l) > far);
    let end = partition_point(labels.count, |l| t(l) >= near);
    let (base, step) = rays.in_frame(i).homogeneous();
    let v = |scale: f32| f64::from(scale) * f64::from(dir_z);
    let start = std::array::from_fn(|c| step[c] + v(labels.lo) * base[c]);
    Ray::new(start, base.map(|b| v(labels.step) * b), [first as u32, end as u32])
}

/// The first of `0..n` for which `before` no longer holds.
fn partition_point(n: usize, before: impl Fn(usize) -> bool) -> usize {
    let (mut lo, mut hi) = (0, n);
    while lo < hi {
        let mid = (lo + hi) / 2;
        if before(mid) { lo = mid + 1 } else { hi = mid }
    }
    lo
}

/// The label of every kept pixel.
///
/// # Errors
///
/// The device failed, or the problem is too large for it.
#[allow(clippy::too_many_arguments)]
pub(crate) fn solve(
    m: &Measurements,
    rays: &CameraRays,
    grid: &SplineEvaluator<'_>,
    valid: &Validity,
    prior: [f32; 2],
    labels: &DepthHypotheses,
    penalties: &Penalties,
    kept: &[usize],
    device: &Device,
) -> Result<Vec<Winner>, DeviceError> {
    let pixels: Vec<u32> = kept.iter().map(|i| *i as u32).collect();
    let lines: Vec<Ray> = kept.par_iter().map(|i| ray(*i, rays, labels)).collect();
    cost_volume::winners(
        device,
        &Problem {
            width: m.width,
            height: m.height,
            pixels: &pixels,
            labels: labels.count,
            rays: &lines,
            p: &m.p,
            inv_var: &m.inv_var,
            surround: &m.surround,
            lattice: grid.lattice(),
            lit: Lit { cells: valid.shape.cells, lit: &valid.lit },
            prior,
            saturation: saturation(m),
            step: penalties.step,
            jump: penalties.jump,
        },
    )
}
