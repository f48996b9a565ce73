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
use rayon::prelude::*;

use super::indirect::{Surface, gather};
use super::lookup::{Lookup, Rays};
use super::measure::{Measurements, SharesPrior};
use super::shares::Shares;
use super::thin_plate::{Plate, Until};
use super::uncertainty::{self, Information, systematic};
use super::window::Window;
use crate::progress::Progress;

/// Settings of the refinement.
#[derive(Clone, Copy, Debug)]
pub struct RefineSettings {
    /// Gauss-Newton steps.
    pub steps: usize,
    /// Ends earlier when the surface moves by less than this in a step (mean over its pixels), labels; 0 never does.
    pub settled: f32,
    /// Width 1/inv_s of the surface at the first step, mm.
    pub first_width_mm: f32,
    /// And at the last, mm.
    pub last_width_mm: f32,
    /// How much rougher than [`Self::roughness`] the plate is at the first step at least; it is as smooth as that after [`LOOSE_STEPS`]. A
    /// surface that was smoothed before would else decide how smooth the new one is, whatever the data say.
    pub loosened: f32,
    /// Most patches that the surface throws indirect light as; 0 for none.
    pub patches: usize,
    /// How often the indirect light is gathered anew.
    pub gathers: usize,
    /// The step before which that happens first.
    pub first_gather: usize,
    /// Prior of the light that is not in c.
    pub shares: SharesPrior,
    /// Radius over which the shares are smooth, px.
    pub ambient_radius: usize,
    /// Least roughness of the surface: standard deviation of second differences between neighboring pixels, in labels (a
    /// label is about 0.7 px of disparity). Smaller is smoother.
    pub roughness: f32,
}

/// A refined surface over the window of the image that holds kept pixels. All maps have the whole image's size.
pub struct Refined {
    /// Inverse depth, 1/mm; NaN where there is none.
    pub inv_z: Vec<f32>,
    /// Its standard deviation, 1/mm (`uncertainty.rs`).
    pub sigma: Vec<f32>,
    /// Share per pixel, mean over color channels, of the light that is not in c.
    pub ambient: Vec<f32>,
    /// χ² per measurement of a pixel.
    pub chi2: Vec<f32>,
    /// Root mean square residual of the normalized intensities.
    pub residual: Vec<f32>,
    /// Median absolute residual of the normalized intensities.
    pub abs_residual: Vec<f32>,
    /// The loss after every step: mean robust χ² per measurement.
    pub losses: Vec<f32>,
    /// Albedo per color channel, as far as interreflection tells it; 0 without gathered light.
    pub albedo: Vec<f32>,
}

impl Refined {
    fn empty(n: usize) -> Self {
        let nan = || vec![f32::NAN; n];
        Self {
            inv_z: nan(),
            sigma: nan(),
            ambient: vec![0.0; n],
            chi2: nan(),
            residual: nan(),
            abs_residual: nan(),
            losses: Vec::new(),
            albedo: Vec::new(),
        }
    }
}

/// NeuS weights of a planar surface crossing the band are those of a logistic density of width 1/inv_s, cut off at four
/// widths. Three samples integrate any polynomial up to degree 5 against it exactly (Gauss), which a spline nearly is over
/// a band this narrow: offsets along f in units of the width, and their weights.
fn band() -> [(f32, f32); 3] {
    let bounds: Vec<f64> = (0..=64).map(|j| 4.0 - 8.0 * f64::from(j) / 64.0).collect();
    let mut weights = vec![0.0; bounds.len()];
    render_weights(&bounds, 1.0, &mut weights);
    let total: f64 = weights.iter().sum();
    let moment = |power: i32| -> f64 {
        bounds.windows(2).zip(&weights).map(|(b, w)| w * (0.5 * (b[0] + b[1])).powi(power)).sum::<f64>() / total
    };
    // The density is symmetric: nodes 0 and ±√(m4 / m2).
    let (m2, m4) = (moment(2), moment(4));
    let (node, side) = ((m4 / m2).sqrt() as f32, (0.5 * m2 * m2 / m4) as f32);
    [(-node, side), (0.0, 1.0 - 2.0 * side), (node, side)]
}

/// Called after every step with its number and a function that makes the present depth map.
pub type Watch<'a> = dyn FnMut(usize, &dyn Fn() -> Vec<f32>) + 'a;

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
}

/// Refines inverse depths (NaN = none). `unit` is the label spacing of the decoder, the natural unit of 1/z here.
#[allow(clippy::too_many_arguments)]
pub fn refine(
    m: &Measurements,
    rays: &Rays,
    lookup: &Lookup<'_>,
    start: &[f32],
    unit: f32,
    channels: usize,
    s: &RefineSettings,
    progress: &Progress,
    watch: &mut Watch<'_>,
) -> Refined {
    let n = m.n();
    let k = m.k;
    let Some(win) = Window::around(start, m.width) else { return Refined::empty(n) };
    let nw = win.w * win.h;
    let active: Vec<bool> = (0..nw).map(|i| !win.in_ring(i) && start[win.at(i)].is_finite()).collect();
    // The unknown, in units of the label spacing, relative to the middle of what is there.
    let mid = {
        let v: Vec<f32> = (0..nw).filter(|i| active[*i]).map(|i| start[win.at(i)]).collect();
        v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64
    } as f32;
    let mut x: Vec<f32> = (0..nw).map(|i| if active[i] { (start[win.at(i)] - mid) / unit } else { 0.0 }).collect();
    let mut plate = Plate::new(win.w, win.h, active.clone());
    let mut shares = Shares::new(m, &win, &active, channels, &s.shares, s.ambient_radius);
    let quadrature = band();
    let mut losses = Vec::new();
    let mut data = vec![Data::default(); nw];
    let mut rendered = vec![0.0f32; nw * 2 * k];

    for step in 0..s.steps {
        if progress.cancelled() {
            break;
        }
        progress.tick(step, s.steps);
        let done = step as f32 / (s.steps - 1).max(1) as f32;
        let width = s.first_width_mm * (s.last_width_mm / s.first_width_mm).powf((done * 1.5).min(1.0));
        let slopes = slopes(&plate, &x, super::MAX_SLOPE * mid / (rays.focal_px * unit));
        if s.patches > 0 && gathers_at(step, s) {
            let slopes: Vec<[f32; 2]> = slopes.iter().map(|s| s.map(|s| s * unit)).collect();
            let surface = Surface::new(&win, &active, rays, |i| mid + unit * x[i], &slopes);
            shares.indirect = Some(gather(&surface, m, channels, rays.focal_px, s.patches));
        }

        // Narrow-band rendering of every pixel: c and its slope per unit of the unknown.
        rendered.par_chunks_mut(2 * k * win.w).enumerate().for_each_init(
            || (vec![0.0; k], vec![0.0; k]),
            |(c, d), (row, out)| {
                for (j, out) in out.chunks_exact_mut(2 * k).enumerate() {
                    let i = row * win.w + j;
                    if !active[i] {
                        continue;
                    }
                    let px = win.at(i);
                    let inv_z = mid + unit * x[i];
                    let t = 1.0 / (inv_z * rays.dir_z(px));
                    let stretch = width / cosine(slopes[i], unit, inv_z, rays.focal_px);
                    let ray = rays.in_frame(px);
                    out.fill(0.0);
                    for (offset, weight) in &quadrature {
                        let p = ray.at(f64::from(t + offset * stretch));
                        lookup.eval_along(p.q, p.dq, c, d);
                        for j in 0..k {
                            out[j] += weight * c[j];
                            out[k + j] += weight * d[j];
                        }
                    }
                    // dt / d(unit of 1/z).
                    let dt = -t / inv_z * unit;
                    out[k..].iter_mut().for_each(|d| *d *= dt);
                }
            },
        );
        shares.update(&rendered);
        let cut = 6.0 * m.independent;
        data.par_iter_mut().enumerate().with_min_len(win.w).for_each(|(i, out)| {
            *out = Data::default();
            if !active[i] {
                return;
            }
            let px = win.at(i);
            let (c, d) = rendered[i * 2 * k..(i + 1) * 2 * k].split_at(k);
            for j in 0..k {
                let iv = m.inv_var[px * k + j];
                let r = shares.explain(i, px, j, c[j]) - m.p[px * k + j];
                let jac = d[j] * (1.0 - shares.shares[i * channels + j % channels].sum());
                out.chi2 += iv * r * r;
                out.h += iv * jac * jac;
                out.g += iv * jac * r;
            }
            // Geman-McClure on the pixel's χ²: a wrong codeword (highlight, mixed pixel) loses its say.
            let robust = 1.0 / (1.0 + out.chi2 / cut);
            out.loss = out.chi2 * robust;
            out.h *= robust * robust;
            out.g *= robust * robust;
        });
        let (sum, count) = data
            .iter()
            .zip(&active)
            .filter(|(_, a)| **a)
            .fold((0.0f64, 0usize), |(s, c), (d, _)| (s + f64::from(d.loss), c + 1));
        losses.push((sum / count as f64) as f32 / m.independent);

        // One Gauss-Newton step. It need not be solved better than the next one will change it.
        let loose = 1.0 + (s.loosened - 1.0) * (1.0 - step as f32 / LOOSE_STEPS).max(0.0);
        plate.reweight(&x, s.roughness * loose, CREASE, ROUGHNESS_RADIUS);
        let h: Vec<f32> = data.iter().map(|d| d.h).collect();
        let b: Vec<f32> = data.iter().zip(&x).map(|(d, x)| d.h * x - d.g).collect();
        let mut next = x.clone();
        plate.solve(&h, &b, &mut next, Until { reduction: STEP_REDUCTION, iterations: 120 });
        let mut way = 0.0f64;
        for i in 0..nw {
            let by = (next[i] - x[i]).clamp(-2.0, 2.0);
            x[i] += by;
            way += f64::from(by.abs());
        }
        watch(step, &|| {
            let mut depth = vec![f32::NAN; n];
            for i in (0..nw).filter(|i| active[*i]) {
                depth[win.at(i)] = 1.0 / (mid + unit * x[i]);
            }
            depth
        });
        // Not before the last gathering of indirect light, and not before the surface is thin.
        let rehearsed = width <= s.last_width_mm && (step + 1..s.steps).all(|later| !gathers_at(later, s));
        if rehearsed && way < f64::from(s.settled) * count as f64 {
            break;
        }
    }

    let information: Vec<Information> =
        data.iter().map(|d| Information { h: d.h, chi2: d.chi2 / m.independent }).collect();
    let (mut whitened, mut slopes) = (vec![0.0f32; nw * k], vec![0.0f32; nw * k]);
    for i in (0..nw).filter(|i| active[*i]) {
        let px = win.at(i);
        for j in 0..k {
            let weight = m.inv_var[px * k + j].sqrt();
            whitened[i * k + j] = weight * (shares.explain(i, px, j, rendered[i * 2 * k + j]) - m.p[px * k + j]);
            slopes[i * k + j] = weight * rendered[i * 2 * k + k + j];
        }
    }
    let shared = systematic(&whitened, &slopes, k, &active, win.w, win.h);
    let sigma = uncertainty::sigma(&plate, &x, &information, &shared);
    let mut out = Refined { losses, albedo: shares.albedo.clone(), ..Refined::empty(n) };
    let mut residuals = vec![0.0f32; k];
    for i in (0..nw).filter(|i| active[*i]) {
        let px = win.at(i);
        out.inv_z[px] = mid + unit * x[i];
        out.sigma[px] = sigma[i] * unit;
        let all = &shares.shares[i * channels..(i + 1) * channels];
        out.ambient[px] = all.iter().map(|s| s.sum()).sum::<f32>() / channels as f32;
        out.chi2[px] = data[i].chi2 / m.independent;
        for j in 0..k {
            residuals[j] = (shares.explain(i, px, j, rendered[i * 2 * k + j]) - m.p[px * k + j]).abs();
        }
        out.residual[px] = (residuals.iter().map(|r| r * r).sum::<f32>() / k as f32).sqrt();
        out.abs_residual[px] = *residuals.select_nth_unstable_by(k / 2, f32::total_cmp).1;
    }
    out
}

/// Second differences beyond this many labels are creases or jumps, where the plate breaks.
const CREASE: f32 = 0.5;
/// Half side of the square over which a surface's local roughness is pooled, px.
const ROUGHNESS_RADIUS: usize = 3;
/// Steps after which a plate is no longer loosened.
pub const LOOSE_STEPS: f32 = 2.0;
/// How far the residual of one step's linear system is brought down.
const STEP_REDUCTION: f64 = 1e-2;

/// Whether the indirect light is gathered before this step: first when the surface has lost the decoder's noise (if it has any),
/// then at even distances.
fn gathers_at(step: usize, s: &RefineSettings) -> bool {
    let first = s.first_gather.min(s.steps.saturating_sub(2));
    (0..s.gathers).any(|g| step == first + g * (s.steps - first) / s.gathers)
}

/// Slopes of the unknown along x and y, per pixel: central differences, one-sided where the other side lies across a jump
/// (a step of more than `most`).
fn slopes(plate: &Plate, x: &[f32], most: f32) -> Vec<[f32; 2]> {
    (0..x.len())
        .into_par_iter()
        .with_min_len(plate.width)
        .map(|i| {
            if !plate.active[i] {
                return [0.0; 2];
            }
            [1, plate.width].map(|stride| {
                let step = |a: usize, b: usize| (plate.active[a] && plate.active[b]).then(|| x[b] - x[a]);
                match (step(i - stride, i), step(i, i + stride)) {
                    (Some(l), Some(r)) if l.abs().max(r.abs()) <= most => 0.5 * (l + r),
                    (Some(l), Some(r)) => {
                        if l.abs() < r.abs() {
                            l
                        } else {
                            r
                        }
                    }
                    (one, None) | (None, one) => one.unwrap_or(0.0),
                }
            })
        })
        .collect()
}

/// cos θ between surface normal and ray from the slope of the present surface; at least 0.2.
#[inline]
fn cosine([du, dv]: [f32; 2], unit: f32, inv_z: f32, focal_px: f32) -> f32 {
    // dz = −z² d(1/z) over a lateral step of z / focal length.
    let tilt = (du * du + dv * dv).sqrt() * unit / inv_z * focal_px;
    (1.0 / (1.0 + tilt * tilt).sqrt()).max(0.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of the logistic density that the NeuS weights sample, cut off at four widths, up to degree 5.
    #[test]
    fn three_samples_stand_for_the_whole_band() {
        let density = |u: f64| (-u).exp() / (1.0 + (-u).exp()).powi(2);
        let moment = |power: i32| -> f64 {
            (0..80_000).map(|i| -4.0 + 8.0 * (f64::from(i) + 0.5) / 80_000.0).map(|u| density(u) * u.powi(power)).sum()
        };
        for power in 0..6 {
            let ours: f64 = band().iter().map(|(u, w)| f64::from(*w) * f64::from(*u).powi(power)).sum();
            let theirs = moment(power) / moment(0);
            assert!((ours - theirs).abs() < 0.01 * theirs.abs().max(1.0), "{power}: {ours} {theirs}");
        }
    }
}
