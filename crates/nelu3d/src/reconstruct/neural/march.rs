//! Samples along rays at even distances, in the occupied part of the cube only.

use nalgebra::{Point3, Vector3};
use nelu3d_field::occupancy::OccupancyGrid;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::config::{STEPS_PER_DIAGONAL, step_units};

/// A ray in the camera's frame, mm.
#[derive(Clone, Copy, Debug)]
pub struct March {
    /// Origin, mm.
    pub origin: Point3<f64>,
    /// Unit direction.
    pub dir: Vector3<f64>,
    /// Distances `[near, far]` between which it is sampled, mm.
    pub range: [f64; 2],
    /// Position of a sample within its step, in `[0, 1)`.
    pub offset: f64,
}

/// The samples of some rays. Ray r owns `offsets[r]..offsets[r + 1]`, front to back.
#[derive(Clone, Debug, Default)]
pub struct RaySamples {
    /// First sample of every ray and, last, the number of samples.
    pub offsets: Vec<usize>,
    /// Distance along the ray, mm.
    pub t: Vec<f32>,
    /// Position in the unit cube.
    pub points: Vec<[f32; 3]>,
    /// Length of the interval in whose middle the sample lies, units.
    pub lengths: Vec<f32>,
}

impl RaySamples {
    /// Joins the samples of groups of rays, in order; the offsets of a group's rays are their ends.
    pub(super) fn concatenate(groups: Vec<RaySamples>) -> Self {
        let n = groups.iter().map(|c| c.t.len()).sum();
        let mut all = RaySamples {
            offsets: vec![0],
            t: Vec::with_capacity(n),
            points: Vec::with_capacity(n),
            lengths: Vec::with_capacity(n),
        };
        for group in groups {
            let first = all.t.len();
            all.offsets.extend(group.offsets.iter().map(|o| first + o));
            all.t.extend_from_slice(&group.t);
            all.points.extend_from_slice(&group.points);
            all.lengths.extend_from_slice(&group.lengths);
        }
        all
    }
}

/// Returns the distance between two samples, mm.
pub fn step_mm(bounds: &Bounds) -> f64 {
    bounds.side_mm() * 3f64.sqrt() / STEPS_PER_DIAGONAL
}

/// Samples rays at even distances in the occupied part of the cube.
pub fn march(rays: &[March], bounds: &Bounds, grid: &OccupancyGrid) -> RaySamples {
    const CHUNK: usize = 64;
    let step = step_mm(bounds);
    let scale = 1.0 / bounds.side_mm();
    let chunks: Vec<RaySamples> = rays
        .par_chunks(CHUNK)
        .map(|rays| {
            let mut out = RaySamples::default();
            for ray in rays {
                let [near, far] = bounds.clip(&ray.origin, &ray.dir, ray.range);
                // In the cube's coordinates, p + t d.
                let p = (ray.origin - bounds.center) * scale + Vector3::repeat(0.5);
                let d = ray.dir * scale;
                let n = if near < far { ((far - near) / step - ray.offset).ceil().max(0.0) as usize } else { 0 };
                for j in 0..n {
                    let t = near + (j as f64 + ray.offset) * step;
                    let point = std::array::from_fn(|a| (p[a] + t * d[a]) as f32);
                    if grid.is_occupied(point) {
                        out.t.push(t as f32);
                        out.points.push(point);
                        out.lengths.push(step_units());
                    }
                }
                out.offsets.push(out.t.len());
            }
            out
        })
        .collect();
    RaySamples::concatenate(chunks)
}
