//! A signed distance field rendered along rays: distances and normals.

use nalgebra::Vector3;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::NeuralSurface;
use nelu3d_field::volrend::cpu as volrend;

use super::bounds::Bounds;
use super::march::{March, march};

/// A signed distance field rendered from a camera: maps of `height × width`, NaN where there is no surface.
#[derive(Clone, Debug)]
pub struct RenderedView {
    /// Camera z, mm.
    pub depth: Vec<f32>,
    /// Standard deviation of the rendering weights in depth, mm.
    pub spread: Vec<f32>,
    /// Unit normals.
    pub normals: Vec<[f32; 3]>,
}

impl RenderedView {
    /// Makes maps of `n` pixels without a surface at any of them.
    pub fn empty(n: usize) -> Self {
        Self { depth: vec![f32::NAN; n], spread: vec![f32::NAN; n], normals: vec![[f32::NAN; 3]; n] }
    }
}

/// Rendered distances, one per ray.
#[derive(Clone, Debug)]
pub struct RenderedRays {
    /// Distance Σ w t / O along the ray, mm; NaN where the opacity is below a half.
    pub t: Vec<f32>,
    /// Standard deviation of the weights along the ray, mm.
    pub spread: Vec<f32>,
    /// Opacity O = Σ w.
    pub opacity: Vec<f32>,
}

/// Returns the mean place of an interval's weight, 0 (its near end) to 1, where the signed distance is linear in between:
/// ∫ u dΦ(a + (b − a) u) / (Φ(b) − Φ(a)) with the logistic function Φ, `a` and `b` the signed distances at the two ends
/// times the sharpness (`inv_s`). A sharp surface is where the distance is zero; a soft one fills the interval evenly.
pub fn mean_place(a: f64, b: f64) -> f64 {
    /// Weight below which the interval has none to speak of: its middle is as good.
    const NONE: f64 = 1e-9;
    let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
    let softplus = |x: f64| x.max(0.0) + (-x.abs()).exp().ln_1p();
    let weight = logistic(b) - logistic(a);
    if weight.abs() < NONE || (b - a).abs() < 1e-4 {
        return 0.5;
    }
    ((logistic(b) - (softplus(b) - softplus(a)) / (b - a)) / weight).clamp(0.0, 1.0)
}

/// Renders distances Σ w t / O, every interval's weight at its mean place ([`mean_place`]): a trained surface is sharper
/// than the steps of the march, and the middles of steps would put it up to half a step off.
pub fn render(surface: &NeuralSurface, bounds: &Bounds, grid: &OccupancyGrid, rays: &[March]) -> RenderedRays {
    const CHUNK: usize = 8192;
    let n = rays.len();
    let longest = 1.5 * super::march::step_mm(bounds);
    let mut out =
        RenderedRays { t: Vec::with_capacity(n), spread: Vec::with_capacity(n), opacity: Vec::with_capacity(n) };
    for rays in rays.chunks(CHUNK) {
        let samples = march(rays, bounds, grid);
        let mut sdf = vec![0.0; samples.points.len()];
        surface.field().query(&samples.points, &mut sdf);
        let mut weights = vec![0.0; sdf.len()];
        let inv_s = surface.inv_s();
        volrend::render_weights(&samples.offsets, &sdf, inv_s as f32, &mut weights);
        for ray in samples.offsets.windows(2) {
            let (w, t, sdf) = (&weights[ray[0]..ray[1]], &samples.t[ray[0]..ray[1]], &sdf[ray[0]..ray[1]]);
            let (mut o, mut first, mut second) = (0.0f64, 0.0f64, 0.0f64);
            for (j, &w) in w.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                // A weight belongs to the interval behind its sample. Across a gap in the occupied part the surface
                // lies at its near end.
                let gap = t.get(j + 1).map_or(0.0, |next| f64::from(next - t[j]));
                let behind = match sdf.get(j + 1) {
                    Some(next) if gap <= longest => {
                        gap * mean_place(inv_s * f64::from(sdf[j]), inv_s * f64::from(*next))
                    }
                    _ => 0.5 * gap.min(longest),
                };
                let at = f64::from(t[j]) + behind;
                let w = f64::from(w);
                o += w;
                first += w * at;
                second += w * at * at;
            }
            let mean = first / o;
            let opaque = o >= 0.5;
            out.t.push(if opaque { mean as f32 } else { f32::NAN });
            out.spread.push(if opaque { (second / o - mean * mean).max(0.0).sqrt() as f32 } else { f32::NAN });
            out.opacity.push(o as f32);
        }
    }
    out
}

/// Returns the unit normals at distances `t` along rays, mm, facing the camera where the field does; NaN where `t` is.
pub fn normals(surface: &NeuralSurface, bounds: &Bounds, rays: &[March], t: &[f32]) -> Vec<[f32; 3]> {
    let hits: Vec<usize> = (0..t.len()).filter(|&i| t[i].is_finite()).collect();
    let points: Vec<[f32; 3]> =
        hits.iter().map(|&i| bounds.to_cube(&(rays[i].origin + rays[i].dir * f64::from(t[i])))).collect();
    let mut sdf = vec![0.0; points.len()];
    let mut slopes = vec![[0.0; 3]; points.len()];
    surface.field().query_with_jacobian(&points, &mut sdf, &mut slopes);
    let mut out = vec![[f32::NAN; 3]; t.len()];
    for (&i, slope) in hits.iter().zip(slopes) {
        let n = Vector3::from(slope);
        // The cube's axes are equally long, so the gradient's direction is that in space.
        out[i] = (n / n.norm().max(1e-20)).into();
    }
    out
}
