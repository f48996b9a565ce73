//! The state of the refinement and its steps.

mod give_back;
mod roughness;
mod strip;

use nelu3d_field::bench::Demand;
use nelu3d_field::plate::{PlateStop, Sweep, sweep};
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::bands::Bands;
use super::interreflection::{GatherSurface, gather};
use super::light_fractions::LightFractions;
use super::refined::Refined;
use super::scene_light::SceneLight;
use super::seen::Seen;
use super::settings::RefineSettings;
use super::slopes::{cosine, slopes};
use super::thin_plate::ThinPlatePrior;
use super::window::Window;
use crate::color_field::frame::Center;
use crate::color_field::{ColorField, SplineEvaluator};
use crate::reconstruct::initialize::InitialDepth;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::scene::Scene;
use crate::surface::MAX_SLOPE;

/// Largest change of a pixel in a step, steps of depth.
const MAX_CHANGE: f32 = 2.0;

/// The data term at the present depth, per pixel: the normal equation of its step, and its χ²; 0 where there is no
/// surface.
struct DataTerm {
    /// Information Σ w J², robust.
    h: Vec<f32>,
    /// Gradient Σ w J r, robust.
    g: Vec<f32>,
    /// χ², not robust.
    chi2: Vec<f32>,
}

/// The state of the refinement, over a window around the surface.
pub(super) struct Refinement<'a> {
    scene: &'a Scene<'a>,
    spline: SplineEvaluator<'a>,
    settings: &'a RefineSettings,
    window: &'a Window,
    active: &'a [bool],
    /// Number of active pixels.
    pub(super) n_active: usize,
    channels: usize,
    /// Mean inverse depth of the initial surface, 1/mm.
    mid: f32,
    /// Unit of the unknown, 1/mm.
    unit: f32,
    /// The unknown x per pixel: 1/z = mid + unit · x.
    x: Vec<f32>,
    prior: ThinPlatePrior,
    /// Light fractions of the pixels.
    fractions: LightFractions<'a>,
    /// What changes the codewords of the whole scene.
    scene_light: SceneLight<'a>,
    data: DataTerm,
    /// What a pixel's information about depth is worth beside what its noise says: see [`trust`].
    trust: f32,
    /// c across the narrow band, and its slope by the unknown, `n × 2 k`.
    rendered: Vec<f32>,
    /// Where the light of the pixels comes from.
    seen: Seen,
    /// The rays to there, and what was evaluated along them.
    bands: Bands,
}

/// Returns what a pixel's information about depth is worth beside what its noise says: depths of single pixels scatter
/// more where errors of the color field go along the code's slope, and a surface that followed them would be rougher
/// than the true one.
fn trust(field: &ColorField) -> f32 {
    1.0 / field.metadata.depth_noise_factor(TRUST_PIXELS, None).min(MAX_DISTRUST)
}

/// Number of pixels whose mean's scatter counts: about what the prior averages over.
const TRUST_PIXELS: f32 = 16.0;
/// The largest factor of the noise's variance that is believed.
const MAX_DISTRUST: f32 = 4.0;

impl<'a> Refinement<'a> {
    /// Begins at the initial surface.
    pub(super) fn new(
        scene: &'a Scene<'a>,
        initial: &InitialDepth,
        settings: &'a RefineSettings,
        (fractions, board): (&LightFractionPrior, Option<[f32; 3]>),
        window: &'a Window,
        active: &'a [bool],
    ) -> Self {
        let m = &scene.measurements;
        let (n, k, channels) = (window.n(), m.k, scene.white.channels);
        let pixels = || (0..n).filter(|i| active[*i]);
        let n_active = pixels().count();
        let mid = (pixels().map(|i| f64::from(initial.inv_z[window.at(i)])).sum::<f64>() / n_active as f64) as f32;
        let unit = initial.step;
        let x = (0..n).map(|i| if active[i] { (initial.inv_z[window.at(i)] - mid) / unit } else { 0.0 }).collect();
        let x: Vec<f32> = x;
        let seen = Seen::new(m, &scene.field.metadata.noise, scene.blur, window, active);
        let line = |i: usize| {
            let (ray, dir_z) = scene.rays.in_frame_beside(window.at(i), seen.shift(i));
            ray.by_inverse_depth(mid + unit * x[i], unit, dir_z)
        };
        let bands = Bands::new(window.w, k, active, &x, line);
        let radius = (m.image[0] / settings.ambient_radius_divisor).max(2);
        let light = scene.rays.frame.center().filter(|_| scene.field.metadata.center == Center::Light);
        Self {
            scene,
            spline: scene.spline(),
            settings,
            window,
            active,
            n_active,
            channels,
            mid,
            unit,
            x,
            prior: ThinPlatePrior::new(window.w, window.h, active.to_vec()),
            fractions: LightFractions::new(m, window, active, channels, fractions, radius),
            scene_light: SceneLight::new(m, &scene.rays, window, active, (light, mid), board),
            data: DataTerm { h: vec![0.0; n], g: vec![0.0; n], chi2: vec![0.0; n] },
            trust: trust(scene.field),
            rendered: vec![0.0; n * 2 * k],
            seen,
            bands,
        }
    }

    /// Returns the inverse depth of a pixel of the window, 1/mm.
    #[inline]
    fn inv_z(&self, i: usize) -> f32 {
        self.mid + self.unit * self.x[i]
    }

    /// Returns inverse depth 1/z per pixel of the image, 1/mm; NaN where there is no surface.
    pub(super) fn inverse_depth(&self) -> Vec<f32> {
        let mut inv_z = vec![f32::NAN; self.scene.measurements.n()];
        for i in (0..self.x.len()).filter(|i| self.active[*i]) {
            inv_z[self.window.at(i)] = self.inv_z(i);
        }
        inv_z
    }

    /// Returns camera z per pixel of the image, mm; NaN where there is no surface.
    pub(super) fn depth(&self) -> Vec<f32> {
        self.inverse_depth().into_iter().map(|v| 1.0 / v).collect()
    }

    /// Returns the slopes of the unknown along x and y, per pixel.
    pub(super) fn slopes(&self) -> Vec<[f32; 2]> {
        slopes(&self.prior, &self.x, MAX_SLOPE * self.mid / (self.scene.rays.focal_px * self.unit))
    }

    /// Gathers interreflection from the present surface.
    pub(super) fn gather_interreflection(&mut self, slopes: &[[f32; 2]]) -> Demand {
        // As large as what comes in its place.
        self.fractions.interreflection = None;
        let slope = |i: usize| slopes[i].map(|s| s * self.unit);
        let (rays, m) = (&self.scene.rays, &self.scene.measurements);
        let surface = GatherSurface::new(self.window, self.active, rays, |i| self.inv_z(i), slope);
        let (gathered, demand) = gather(&surface, m, self.channels, rays.focal_px, self.settings.patches);
        self.fractions.interreflection = Some(gathered);
        demand
    }

    /// Estimates the light fractions anew, and what changes the whole scene's light once the surface has lost the
    /// decoder's noise.
    pub(super) fn update_fractions(&mut self, slopes: &[[f32; 2]], step: usize) {
        self.fractions.update(&self.rendered);
        if step >= self.settings.first_gather {
            let (x, mid, unit) = (&self.x, self.mid, self.unit);
            let depths = |i: usize| (mid + unit * x[i], slopes[i].map(|s| s * unit));
            self.scene_light.update(&self.rendered, &self.fractions, depths);
        }
    }

    /// Renders the narrow band of every pixel: c and its slope per unit of the unknown. `width` is 1/inv_s, mm.
    pub(super) fn render(&mut self, slopes: &[[f32; 2]], width: f32) -> Demand {
        let (rays, unit) = (&self.scene.rays, self.unit);
        let (x, mid, window) = (&self.x, self.mid, self.window);
        // What a step along the ray is in the unknown: t = 1 / (inv_z · dir_z).
        let spread = |i: usize| {
            let inv_z = mid + unit * x[i];
            let stretch = width / cosine(slopes[i], unit, inv_z, rays.focal_px);
            stretch * inv_z * inv_z * rays.dir_z(window.at(i)) / unit
        };
        let at = self.seen.of(x, slopes);
        let demand = self.bands.render(&self.spline, self.active, &at, spread, &mut self.rendered);
        self.scene_light.change(&mut self.rendered, |i| (mid + unit * x[i], slopes[i].map(|s| s * unit)));
        demand
    }

    /// Returns the unweighted residual (model − measured) of channel `j` at pixel `i` of the window, pixel `px` of the
    /// image.
    #[inline]
    fn residual(&self, i: usize, px: usize, j: usize) -> f32 {
        let m = &self.scene.measurements;
        self.fractions.explain(i, px, j, self.rendered[i * 2 * m.k + j]) - m.p[px * m.k + j]
    }

    /// Returns c of the robust loss χ²/(1 + χ²/c) (Geman and McClure).
    fn robust_cut(&self) -> f32 {
        self.settings.robust_chi2 * self.scene.measurements.independent
    }

    /// Sets up the normal equation of every pixel; returns the loss, mean robust χ² per measurement.
    pub(super) fn linearize(&mut self) -> f32 {
        let m = &self.scene.measurements;
        let (k, channels, w) = (m.k, self.channels, self.window.w);
        let cut = self.robust_cut();
        let DataTerm { mut h, mut g, mut chi2 } =
            std::mem::replace(&mut self.data, DataTerm { h: Vec::new(), g: Vec::new(), chi2: Vec::new() });
        let rows = h.par_chunks_mut(w).zip(g.par_chunks_mut(w)).zip(chi2.par_chunks_mut(w)).enumerate();
        let losses: Vec<f64> = rows
            .map(|(y, ((h, g), chi2))| {
                let mut loss = 0.0f64;
                for x in (0..w).filter(|x| self.active[y * w + x]) {
                    let i = y * w + x;
                    let px = self.window.at(i);
                    let d = &self.rendered[(2 * i + 1) * k..(2 * i + 2) * k];
                    let [mut information, mut gradient, mut misfit] = [0.0f32; 3];
                    for j in 0..k {
                        let iv = m.inv_var[px * k + j];
                        let r = self.residual(i, px, j);
                        let jac = d[j] * (1.0 - self.fractions.of_pixels[i * channels + j % channels].sum());
                        misfit += iv * r * r;
                        information += iv * jac * jac;
                        gradient += iv * jac * r;
                    }
                    // Geman-McClure on the pixel's χ²: a wrong codeword (highlight, mixed pixel) counts little.
                    let robust = 1.0 / (1.0 + misfit / cut);
                    loss += f64::from(misfit * robust);
                    chi2[x] = misfit;
                    let weight = self.trust * robust * robust;
                    h[x] = information * weight;
                    g[x] = gradient * weight;
                }
                loss
            })
            .collect();
        self.data = DataTerm { h, g, chi2 };
        (losses.iter().sum::<f64>() / self.n_active as f64) as f32 / m.independent
    }

    /// Sets the weights of the prior at a step.
    pub(super) fn reweight(&mut self, step: usize) {
        let s = self.settings;
        self.prior.reweight(&self.x, s.roughness_at(step), s.crease, s.roughness_radius);
    }

    /// Takes one Gauss-Newton step; returns by how much depth changed, steps of depth. Its linear system need not be
    /// solved better than the next step will change it: one sweep over its tiles is enough.
    pub(super) fn gauss_newton_step(&mut self, step: usize) -> Sweep {
        let s = self.settings;
        let until =
            PlateStop { reduction: s.solver_reduction, settled: s.solver_settled, iterations: s.solver_iterations };
        let system = self.prior.system(&self.data.h, &self.data.g);
        sweep(&system, &mut self.x, step, MAX_CHANGE, until)
    }

    /// Returns the maps of the refined surface.
    pub(super) fn finish(mut self, losses: Vec<f32>) -> Refined {
        // The largest part of the state, and needed no more.
        self.bands.clear();
        let (m, k, channels) = (&self.scene.measurements, self.scene.measurements.k, self.channels);
        // What pixels are rejected by, χ² and light fractions, is that of the surface before.
        let sigma = self.give_back();
        let mut out = Refined::empty(m.n(), losses, self.fractions.albedo.clone());
        (out.flash_offset_mm, out.crosstalk) = (self.scene_light.flash_offset_mm(), self.scene_light.crosstalk());
        let residuals_of = |i: usize| {
            let px = self.window.at(i);
            let usable = (0..k).filter(|j| m.inv_var[px * k + j] > 0.0);
            let mut residuals: Vec<f32> = usable.map(|j| self.residual(i, px, j).abs()).collect();
            let squares = residuals.iter().map(|r| r * r).sum::<f32>() / residuals.len().max(1) as f32;
            (squares.sqrt(), median(&mut residuals).unwrap_or(0.0))
        };
        let pixels: Vec<usize> = (0..self.x.len()).filter(|i| self.active[*i]).collect();
        let residuals: Vec<(f32, f32)> = pixels.par_iter().map(|i| residuals_of(*i)).collect();
        for (i, residuals) in pixels.into_iter().zip(residuals) {
            let px = self.window.at(i);
            (out.residual[px], out.abs_residual[px]) = residuals;
            out.inv_z[px] = self.inv_z(i);
            out.sigma[px] = sigma[i] * self.unit;
            let fractions = &self.fractions.of_pixels[i * channels..(i + 1) * channels];
            out.ambient[px] = fractions.iter().map(|f| f.sum()).sum::<f32>() / channels as f32;
            out.unseen[px] = fractions.iter().map(|f| f.ambient + f.unseen).sum::<f32>() / channels as f32;
            out.chi2[px] = self.data.chi2[i] / m.independent_at(px);
        }
        out
    }
}
