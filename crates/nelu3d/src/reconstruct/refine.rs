//! Narrow-band volume rendering of the surface, to the accuracy that the noise allows.
//!
//! The signed distance field of the `fast` recipe lives on the camera's own lattice: along the ray of pixel i,
//! f(t) = cos θ_i (t_i − t), so that |∇f| = 1 where the surface is smooth (the eikonal condition holds by construction and
//! needs no loss), every ray crosses its own zero level set exactly once (no sheets behind the object), and neighbors are
//! coupled only by a thin plate that breaks at depth jumps (no bridges across them). Rendering it with NeuS weights is a
//! quadrature of c across the surface with a logistic of width 1/inv_s; inv_s grows as the fit converges. What is left of
//! method.md §2 is the image loss, weighed by the noise of every measurement instead of a fixed blend, the ambient term
//! and the mask. It is minimized by Gauss-Newton, each step one sparse linear system.

use nelu3d_field::volrend::reference::render_weights;
use rand::SeedableRng;
use rayon::prelude::*;

use super::box_mean;
use super::decode::Rays;
use super::measure::{Measurements, SharesPrior, SharesSum};
use super::thin_plate::Plate;
use crate::color_field::grid::Grid;
use crate::progress::Progress;

/// Settings of the refinement.
#[derive(Clone, Copy, Debug)]
pub struct RefineSettings {
    /// Gauss-Newton steps.
    pub steps: usize,
    /// Width 1/inv_s of the surface at the first step, mm.
    pub first_width_mm: f32,
    /// And at the last, mm.
    pub last_width_mm: f32,
    /// Samples per ray in the narrow band.
    pub samples: usize,
    /// Prior of the light that is not in c.
    pub shares: SharesPrior,
    /// Radius over which the ambient term is smooth, px.
    pub ambient_radius: usize,
    /// Least roughness of the surface: standard deviation of second differences between neighboring pixels, in labels (a
    /// label is about 0.7 px of disparity). Smaller is smoother.
    pub roughness: f32,
    /// Draws for the uncertainty.
    pub draws: usize,
    /// Seed of everything random.
    pub seed: u64,
}

/// A refined surface over the window of the image that holds kept pixels. All maps have the whole image's size.
pub struct Refined {
    /// Inverse depth, 1/mm; NaN where there is none.
    pub inv_z: Vec<f32>,
    /// Its standard deviation from the measurements' noise and the surface's own smoothness, 1/mm.
    pub sigma: Vec<f32>,
    /// Ambient share per pixel and color channel.
    pub ambient: Vec<f32>,
    /// χ² per measurement of a pixel.
    pub chi2: Vec<f32>,
    /// Root mean square residual of the normalized intensities.
    pub residual: Vec<f32>,
    /// Median absolute residual of the normalized intensities.
    pub abs_residual: Vec<f32>,
    /// The loss after every step: mean robust χ² per measurement.
    pub losses: Vec<f32>,
}

/// NeuS weights of a planar surface crossing the band: offsets along f in units of the width, and their weights.
fn band(samples: usize) -> Vec<(f32, f32)> {
    // Interval bounds from +4 to −4 widths; a sample stands in the middle of each interval.
    let bounds: Vec<f64> = (0..=samples).map(|j| 4.0 - 8.0 * j as f64 / samples as f64).collect();
    let mut weights = vec![0.0; bounds.len()];
    render_weights(&bounds, 1.0, &mut weights);
    weights.pop();
    let total: f64 = weights.iter().sum();
    weights.iter().enumerate().map(|(j, w)| (-0.5 * (bounds[j] + bounds[j + 1]) as f32, (*w / total) as f32)).collect()
}

/// What the data say about one pixel at the present depth: the normal equation of its step, and its misfit.
#[derive(Clone, Copy, Default)]
struct Data {
    /// Σ w J².
    h: f32,
    /// Σ w J r.
    g: f32,
    /// Robust χ².
    loss: f32,
    chi2: f32,
    sum_sq: f32,
    abs: f32,
}

struct Window {
    x0: usize,
    y0: usize,
    w: usize,
    h: usize,
}

/// Refines inverse depths (NaN = none). `unit` is the label spacing of the decoder, the natural unit of 1/z here.
pub fn refine(
    m: &Measurements,
    rays: &Rays,
    grid: &Grid,
    start: &[f32],
    unit: f32,
    channels: usize,
    s: &RefineSettings,
    progress: &Progress,
) -> Refined {
    let n = m.n();
    let k = m.k;
    let Some(win) = window(m, start) else {
        return Refined {
            inv_z: vec![f32::NAN; n],
            sigma: vec![f32::NAN; n],
            ambient: vec![0.0; n * channels],
            chi2: vec![f32::NAN; n],
            residual: vec![f32::NAN; n],
            abs_residual: vec![f32::NAN; n],
            losses: Vec::new(),
        };
    };
    let at = |i: usize| (win.y0 + i / win.w) * m.width + win.x0 + i % win.w;
    let nw = win.w * win.h;
    let active: Vec<bool> = (0..nw).map(|i| start[at(i)].is_finite()).collect();
    // The unknown, in units of the label spacing, relative to the middle of what is there.
    let mid = {
        let v: Vec<f32> = (0..nw).filter(|i| active[*i]).map(|i| start[at(i)]).collect();
        v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64
    } as f32;
    let mut x: Vec<f32> = (0..nw).map(|i| if active[i] { (start[at(i)] - mid) / unit } else { 0.0 }).collect();
    let mut plate = Plate::new(win.w, win.h, active);
    let mut shares = vec![[0.0f32; 2]; nw * channels];
    let quadrature = band(s.samples);
    let mut losses = Vec::new();
    let mut data = vec![Data::default(); nw];
    let mut rng = rand::rngs::StdRng::seed_from_u64(s.seed);

    for step in 0..s.steps {
        if progress.cancelled() {
            break;
        }
        progress.tick(step, s.steps);
        let done = step as f32 / (s.steps - 1).max(1) as f32;
        let width = s.first_width_mm * (s.last_width_mm / s.first_width_mm).powf((done * 1.5).min(1.0));
        // Narrow-band rendering of every pixel.
        let cosines = cosines(&plate, &x, rays, &win, mid, unit);
        let render = |i: usize, c: &mut [f32], d: &mut [f32], out: &mut [f32], dout: &mut [f32]| {
            let px = at(i);
            let inv_z = mid + unit * x[i];
            let t = 1.0 / (inv_z * rays.dir_z[px]);
            let stretch = width / cosines[i];
            out.fill(0.0);
            dout.fill(0.0);
            for (offset, weight) in &quadrature {
                let p = rays.in_frame[px].at(f64::from(t + offset * stretch));
                grid.eval_along(p.q, p.dq, c, d);
                for j in 0..k {
                    out[j] += weight * c[j];
                    dout[j] += weight * d[j];
                }
            }
            // dt / d(unit of 1/z).
            let dt = -t / inv_z * unit;
            dout.iter_mut().for_each(|d| *d *= dt);
        };
        let mut rendered = vec![0.0f32; nw * 2 * k];
        rendered.par_chunks_mut(2 * k * win.w).enumerate().for_each(|(row, out)| {
            let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
            for (j, out) in out.chunks_exact_mut(2 * k).enumerate() {
                let i = row * win.w + j;
                if plate.active[i] {
                    let (a, b) = out.split_at_mut(k);
                    render(i, &mut c, &mut d, a, b);
                }
            }
        });
        update_shares(&mut shares, &rendered, m, &plate, &win, channels, s);
        let cut = 6.0 * k as f32;
        data.par_iter_mut().enumerate().for_each(|(i, out)| {
            *out = Data::default();
            if !plate.active[i] {
                return;
            }
            let px = at(i);
            let (c, d) = rendered[i * 2 * k..(i + 1) * 2 * k].split_at(k);
            let mut abs = Vec::with_capacity(k);
            for j in 0..k {
                let [a, b] = shares[i * channels + j % channels];
                let iv = m.inv_var[px * k + j];
                let r = c[j] * (1.0 - a - b) + a + b * m.surround[px * k + j] - m.p[px * k + j];
                let jac = d[j] * (1.0 - a - b);
                out.chi2 += iv * r * r;
                out.sum_sq += r * r;
                abs.push(r.abs());
                out.h += iv * jac * jac;
                out.g += iv * jac * r;
            }
            out.abs = *abs.select_nth_unstable_by(k / 2, f32::total_cmp).1;
            // Geman-McClure on the pixel's χ²: a wrong codeword (highlight, mixed pixel, interreflection) loses its say.
            let robust = 1.0 / (1.0 + out.chi2 / cut);
            out.loss = out.chi2 * robust;
            out.h *= robust * robust;
            out.g *= robust * robust;
        });
        let (sum, count) = data
            .iter()
            .zip(&plate.active)
            .filter(|(_, a)| **a)
            .fold((0.0f64, 0usize), |(s, c), (d, _)| (s + f64::from(d.loss), c + 1));
        losses.push((sum / (count * k) as f64) as f32);

        // One Gauss-Newton step.
        plate.reweight(&x, s.roughness, CREASE, ROUGHNESS_RADIUS);
        let h: Vec<f32> = data.iter().map(|d| d.h).collect();
        let b: Vec<f32> = data.iter().zip(&x).map(|(d, x)| d.h * x - d.g).collect();
        let mut next = x.clone();
        plate.solve(&h, &b, &mut next, 120);
        for i in 0..nw {
            x[i] += (next[i] - x[i]).clamp(-2.0, 2.0);
        }
    }

    let sigma = draw_sigma(&plate, &data, s.draws, &mut rng);
    let mut out = Refined {
        inv_z: vec![f32::NAN; n],
        sigma: vec![f32::NAN; n],
        ambient: vec![0.0; n * channels],
        chi2: vec![f32::NAN; n],
        residual: vec![f32::NAN; n],
        abs_residual: vec![f32::NAN; n],
        losses,
    };
    for i in 0..nw {
        if plate.active[i] {
            let px = at(i);
            out.inv_z[px] = mid + unit * x[i];
            out.sigma[px] = sigma[i] * unit;
            for ch in 0..channels {
                let [a, b] = shares[i * channels + ch];
                out.ambient[px * channels + ch] = a + b;
            }
            out.chi2[px] = data[i].chi2 / k as f32;
            out.residual[px] = (data[i].sum_sq / k as f32).sqrt();
            out.abs_residual[px] = data[i].abs;
        }
    }
    out
}

/// The smallest window around the pixels that have a start.
fn window(m: &Measurements, start: &[f32]) -> Option<Window> {
    let (mut x0, mut y0, mut x1, mut y1) = (usize::MAX, usize::MAX, 0, 0);
    for (i, v) in start.iter().enumerate() {
        if v.is_finite() {
            let (x, y) = (i % m.width, i / m.width);
            (x0, x1) = (x0.min(x), x1.max(x));
            (y0, y1) = (y0.min(y), y1.max(y));
        }
    }
    (x0 <= x1).then(|| Window { x0, y0, w: x1 - x0 + 1, h: y1 - y0 + 1 })
}

/// Second differences beyond this many labels are creases or jumps, where the plate breaks.
const CREASE: f32 = 0.5;
/// Half side of the square over which a surface's local roughness is pooled, px.
const ROUGHNESS_RADIUS: usize = 3;

/// Standard deviation of the posterior by draws: solutions of the last linear system for random right-hand sides with the
/// covariance of data and prior, pooled over 3 × 3 pixels.
fn draw_sigma(plate: &Plate, data: &[Data], draws: usize, rng: &mut rand::rngs::StdRng) -> Vec<f32> {
    use rand_distr::{Distribution, StandardNormal};
    let h: Vec<f32> = data.iter().map(|d| d.h).collect();
    let n = h.len();
    let mut sum = vec![0.0f32; n];
    for _ in 0..draws {
        let mut normal = || -> f32 { StandardNormal.sample(rng) };
        let mut b = plate.noise(&mut normal);
        for i in 0..n {
            b[i] += h[i].sqrt() * normal();
        }
        let mut y = vec![0.0; n];
        plate.solve(&h, &b, &mut y, 80);
        for i in 0..n {
            sum[i] += y[i] * y[i];
        }
    }
    let (w, rows) = (plate.width, plate.height);
    (0..n)
        .into_par_iter()
        .map(|i| {
            let (px, py) = (i % w, i / w);
            let (mut total, mut count) = (0.0, 0);
            for y in py.saturating_sub(1)..(py + 2).min(rows) {
                for x in px.saturating_sub(1)..(px + 2).min(w) {
                    if plate.active[y * w + x] {
                        total += sum[y * w + x];
                        count += draws;
                    }
                }
            }
            (total / count.max(1) as f32).sqrt()
        })
        .collect()
}

/// cos θ between surface normal and ray per pixel, from the slope of the present surface; at least 0.2.
fn cosines(plate: &Plate, x: &[f32], rays: &Rays, win: &Window, mid: f32, unit: f32) -> Vec<f32> {
    let w = win.w;
    (0..x.len())
        .into_par_iter()
        .map(|i| {
            if !plate.active[i] {
                return 1.0;
            }
            let (px, py) = (i % w, i / w);
            let slope = |before: bool, b: usize, after: bool, a: usize| {
                let (before, after) = (before && plate.active[b], after && plate.active[a]);
                match (before, after) {
                    (true, true) => {
                        // The gentler side: the other one may lie across a jump.
                        let (l, r) = (x[i] - x[b], x[a] - x[i]);
                        if l.abs() < r.abs() { l } else { r }
                    }
                    (true, false) => x[i] - x[b],
                    (false, true) => x[a] - x[i],
                    _ => 0.0,
                }
            };
            let du = slope(px > 0, i.wrapping_sub(1), px + 1 < w, i + 1);
            let dv = slope(py > 0, i.wrapping_sub(w), py + 1 < win.h, i + w);
            let inv_z = mid + unit * x[i];
            // dz = −z² d(1/z) over a lateral step of z / focal length.
            let tilt = du.hypot(dv) * unit / inv_z * rays.focal_px;
            (1.0 / (1.0 + tilt * tilt).sqrt()).max(0.2)
        })
        .collect()
}

/// The shares of ambient light (codeword 1, in white and pattern alike) and of interreflection (the codeword of the
/// surroundings), per pixel and color channel: normal equations averaged over a small square, then solved in closed form.
/// With a black image there is no ambient light left, only interreflection.
fn update_shares(
    shares: &mut [[f32; 2]],
    rendered: &[f32],
    m: &Measurements,
    plate: &Plate,
    win: &Window,
    channels: usize,
    s: &RefineSettings,
) {
    let k = m.k;
    let n = win.w * win.h;
    let prior = m.shares_prior(&s.shares);
    for ch in 0..channels {
        let mut sums = vec![vec![0.0f32; n]; 5];
        for i in 0..n {
            if !plate.active[i] {
                continue;
            }
            let px = (win.y0 + i / win.w) * m.width + win.x0 + i % win.w;
            let (mut v, mut chi2) = (SharesSum::default(), 0.0);
            for j in (ch..k).step_by(channels) {
                let (c, p, iv) = (rendered[i * 2 * k + j], m.p[px * k + j], m.inv_var[px * k + j]);
                v.add(c, p, m.surround[px * k + j], iv);
                chi2 += iv * (p - c) * (p - c);
            }
            let robust = 1.0 / (1.0 + chi2 / (30.0 * k as f32));
            for (sum, v) in sums.iter_mut().zip(v.sums) {
                sum[i] = v * robust * robust;
            }
        }
        for sum in &mut sums {
            for _ in 0..2 {
                box_mean(sum, win.w, win.h, s.ambient_radius);
            }
        }
        for i in 0..n {
            let v = SharesSum { sums: [0, 1, 2, 3, 4].map(|j| sums[j][i]) };
            shares[i * channels + ch] = v.solve(prior).0;
        }
    }
}
