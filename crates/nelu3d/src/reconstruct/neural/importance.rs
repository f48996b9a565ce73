//! Samples along rays where the surface may be: what a small budget of samples needs to see as many rays as a large one
//! (NeuS, Sec. 4.1).
//!
//! Marching at a thousandth of the cube's diagonal takes some three hundred samples a ray until the occupancy grid is
//! empty. A ray with more occupied steps than it may have samples is cut into even intervals first; the field at their
//! ends says how much of the ray's weight lies in each; and as many ends again are drawn from that distribution. The
//! samples are the middles of the intervals between all ends.

use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::NeuralSurface;
use nelu3d_field::volrend::cpu as volrend;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::bounds::Bounds;
use super::config::PUBLISHED_SAMPLES;
use super::march::{March, RaySamples, march};

/// Weight that every even interval has besides what the field gives it, per interval.
const FLOOR: f32 = 1e-3;

/// Returns the largest number of samples of a ray in a training of `samples` samples an iteration: `ray_samples` where
/// that is less than published, `None` (rays are marched to their ends) otherwise or where `ray_samples` is 0.
pub fn per_ray(samples: usize, ray_samples: usize) -> Option<usize> {
    (samples < PUBLISHED_SAMPLES && ray_samples > 0).then_some(ray_samples)
}

/// Samples rays with at most `per_ray` samples each where the surface may be, or by marching if that is `None`.
pub fn sample(
    rays: &[March],
    bounds: &Bounds,
    grid: &OccupancyGrid,
    surface: &NeuralSurface,
    per_ray: Option<usize>,
    seed: u64,
) -> RaySamples {
    match per_ray {
        Some(per_ray) => place(rays, bounds, grid, surface, per_ray, seed),
        None => march(rays, bounds, grid),
    }
}

/// Samples rays with at most `per_ray` samples each (at least 4); rays with fewer occupied steps are marched.
pub fn place(
    rays: &[March],
    bounds: &Bounds,
    grid: &OccupancyGrid,
    surface: &NeuralSurface,
    per_ray: usize,
    seed: u64,
) -> RaySamples {
    let even = march(rays, bounds, grid);
    let n_even = (per_ray.max(4) / 2).max(2);
    let is_long = |r: usize| even.offsets[r + 1] - even.offsets[r] > per_ray.max(4);
    // The ends of the even intervals of the long rays, and the weights between them.
    let long: Vec<usize> = (0..rays.len()).filter(|&r| is_long(r)).collect();
    let mut ends: Vec<f32> = Vec::with_capacity(long.len() * (n_even + 1));
    for &r in &long {
        let t = &even.t[even.offsets[r]..even.offsets[r + 1]];
        ends.extend((0..=n_even).map(|i| t[(i * (t.len() - 1)) / n_even]));
    }
    let point = |r: usize, t: f32| bounds.to_cube(&(rays[r].origin + rays[r].dir * f64::from(t)));
    let points: Vec<[f32; 3]> = ends.iter().enumerate().map(|(i, &t)| point(long[i / (n_even + 1)], t)).collect();
    let mut sdf = vec![0.0; points.len()];
    surface.field().query(&points, &mut sdf);
    let offsets: Vec<usize> = (0..=long.len()).map(|i| i * (n_even + 1)).collect();
    let mut weights = vec![0.0; sdf.len()];
    volrend::render_weights(&offsets, &sdf, surface.inv_s() as f32, &mut weights);

    let all: Vec<RaySamples> = (0..rays.len())
        .into_par_iter()
        .map(|r| {
            let Ok(l) = long.binary_search(&r) else {
                let own = even.offsets[r]..even.offsets[r + 1];
                let (t, points) = (even.t[own.clone()].to_vec(), even.points[own.clone()].to_vec());
                return RaySamples { offsets: vec![t.len()], t, points, lengths: even.lengths[own].to_vec() };
            };
            let here = offsets[l]..offsets[l + 1];
            let mut rng = StdRng::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ r as u64);
            let drawn = refine(&ends[here.clone()], &weights[here], per_ray.max(4) - n_even, &mut rng);
            intervals(&drawn, bounds, grid, |t| point(r, t))
        })
        .collect();
    RaySamples::concatenate(all)
}

/// Returns the ends of even intervals together with `n` that are drawn by the intervals' weights, ascending.
fn refine(ends: &[f32], weights: &[f32], n: usize, rng: &mut StdRng) -> Vec<f32> {
    let n_even = ends.len() - 1;
    let share: Vec<f32> = weights[..n_even].iter().map(|w| w + FLOOR).collect();
    let total: f32 = share.iter().sum();
    let mut all = ends.to_vec();
    let (mut interval, mut before) = (0, 0.0);
    for i in 0..n {
        let wanted = total * (i as f32 + rng.random::<f32>()) / n as f32;
        while interval + 1 < n_even && before + share[interval] < wanted {
            before += share[interval];
            interval += 1;
        }
        let within = ((wanted - before) / share[interval]).clamp(0.0, 1.0);
        all.push(ends[interval] + within * (ends[interval + 1] - ends[interval]));
    }
    all.sort_unstable_by(f32::total_cmp);
    all
}

/// Returns the middles of the intervals between neighboring ends, without those in empty cells and those of no length.
fn intervals(ends: &[f32], bounds: &Bounds, grid: &OccupancyGrid, point: impl Fn(f32) -> [f32; 3]) -> RaySamples {
    let mut out = RaySamples::default();
    for end in ends.windows(2) {
        let (middle, length) = (0.5 * (end[0] + end[1]), end[1] - end[0]);
        let q = point(middle);
        if length > 0.0 && grid.is_occupied(q) {
            out.t.push(middle);
            out.points.push(q);
            out.lengths.push(length / bounds.unit_mm as f32);
        }
    }
    out.offsets.push(out.t.len());
    out
}
