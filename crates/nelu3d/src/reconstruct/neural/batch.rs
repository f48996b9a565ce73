//! The rays of one iteration: their pixels, their samples, and the step of the optimizers.

use nalgebra::Point3;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::{Intervals, NeuralSurface, SurfaceBatch, SurfaceLosses};
use nelu3d_scan::Camera;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use super::ambient::{AmbientField, image_point};
use super::bounds::Bounds;
use super::codewords::{Codewords, direction};
use super::importance;
use super::march::{March, RaySamples};
use super::options::{Background, PaperOptions};
use crate::color_field::CameraRays;
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// The pixels that rays are drawn from.
pub(super) struct TrainingPixels {
    /// The cube of the signed distance field.
    pub(super) bounds: Bounds,
    /// Pixels that have a codeword or are dark, in the order of small tiles: neighbors are sampled together.
    pub(super) all: Vec<u32>,
    /// Mask M of each pixel of `all`: whether it is lit.
    pub(super) is_lit: Vec<bool>,
}

impl TrainingPixels {
    /// Selects the pixels of a scene. The mask M is 1 where white is bright enough; saturated pixels and those outside
    /// the calibrated volume are not used. `None` if no pixel is lit.
    pub(super) fn new(m: &Measurements, rays: &CameraRays, settings: &PaperOptions) -> Option<Self> {
        let usable = |i: usize| {
            let [near, far] = rays.range[i];
            let whole = m.inv_var[i * m.k..(i + 1) * m.k].iter().all(|v| *v > 0.0);
            let dark = m.status[i] == PixelStatus::Underexposed && settings.background != Background::Crop;
            near < far && (dark || m.status[i] == PixelStatus::Valid && whole)
        };
        let mut all: Vec<u32> = (0..m.n()).filter(|&i| usable(i)).map(|i| i as u32).collect();
        all.sort_by_key(|&i| (i as usize / m.width / 8, i as usize % m.width / 8, i));
        let is_lit: Vec<bool> = all.iter().map(|&i| m.status[i as usize] == PixelStatus::Valid).collect();
        if !is_lit.contains(&true) {
            return None;
        }
        // The whole calibrated volume, whatever the scene shows: the unit of the losses is that of the rig.
        let inside = (0..m.n()).filter(|&i| rays.range[i][0] < rays.range[i][1]);
        let ends = inside.flat_map(|i| rays.range[i].map(|t| Point3::from(direction(rays, i) * f64::from(t))));
        let mut bounds = Bounds::around(ends)?;
        if let Some(unit_mm) = settings.unit_mm {
            bounds = bounds.with_unit(unit_mm);
        }
        Some(Self { bounds, all, is_lit })
    }

    /// Returns the lit pixels.
    pub(super) fn lit(&self) -> impl Iterator<Item = usize> + '_ {
        self.all.iter().zip(&self.is_lit).filter(|(_, lit)| **lit).map(|(i, _)| *i as usize)
    }

    /// Returns the ray of a pixel, sampled at `offset` of every step.
    pub(super) fn march(&self, rays: &CameraRays, i: usize, offset: f64) -> March {
        March { origin: Point3::origin(), dir: direction(rays, i), range: rays.range[i].map(f64::from), offset }
    }

    /// Returns whether any ray comes near a point of the cube.
    pub(super) fn reaches(&self, camera: &Camera, rays: &CameraRays, q: [f32; 3]) -> bool {
        let x = self.bounds.from_cube(q);
        let Some([u, v]) = camera.project(&x) else { return false };
        // A cell may reach into the image, and into a ray's range, from outside.
        let margin_mm = self.bounds.side_mm() / 64.0;
        let margin_px = margin_mm * camera.fx / x.z;
        let inside = |p: f64, n: usize| p > -margin_px && p < n as f64 - 1.0 + margin_px;
        if !inside(u, camera.width) || !inside(v, camera.height) {
            return false;
        }
        let pixel = |p: f64, n: usize| (p.round().max(0.0) as usize).min(n - 1);
        let [near, far] = rays.range[pixel(v, camera.height) * camera.width + pixel(u, camera.width)].map(f64::from);
        // Next to an empty tile there may be a full one: no ray of its own, but cells that others cross.
        near > far || (near - margin_mm..=far + margin_mm).contains(&x.coords.norm())
    }
}

/// The rays of one iteration.
#[derive(Default)]
pub(super) struct RayBatch {
    samples: RaySamples,
    /// Color field at the samples, `[sample][k]`.
    colors: Vec<f32>,
    /// Measured codewords, `[ray][k]`.
    measured: Vec<f32>,
    /// White − black, `[ray][channel]`.
    light: Vec<f32>,
    /// Mask M, one per ray.
    mask: Vec<f32>,
    /// Unit directions, one per ray.
    dirs: Vec<[f32; 3]>,
    /// Positions in the unit square of the image, one per ray.
    image_points: Vec<[f32; 2]>,
    n_channels: usize,
    k: usize,
}

impl RayBatch {
    /// Draws the rays of iteration `step` at random, samples them (with at most `per_ray` samples where the surface may
    /// be, or by marching if that is `None`), and gathers what was measured along them: black where nothing is lit.
    pub(super) fn draw(
        &mut self,
        pixels: &TrainingPixels,
        m: &Measurements,
        rays: &CameraRays,
        colors: &Codewords<'_>,
        grid: &OccupancyGrid,
        surface: &NeuralSurface,
        n_rays: usize,
        per_ray: Option<usize>,
        seed: u64,
        step: u64,
    ) {
        let mut rng = StdRng::seed_from_u64(seed.wrapping_mul(0x9E37_79B9).wrapping_add(step));
        let mut drawn: Vec<usize> = (0..n_rays).map(|_| rng.random_range(0..pixels.all.len())).collect();
        drawn.sort_unstable();
        let marches: Vec<March> =
            drawn.iter().map(|&p| pixels.march(rays, pixels.all[p] as usize, rng.random())).collect();
        self.samples = importance::sample(&marches, &pixels.bounds, grid, surface, per_ray, rng.random());
        let (k, n) = (m.k, self.samples.t.len());
        self.k = k;
        self.n_channels = m.light.len() / m.n();
        self.colors.resize(n * k, 0.0);
        let pixel = |r: usize| pixels.all[drawn[r]] as usize;
        colors.along_rays(rays, &self.samples, pixel, &mut self.colors);
        self.measured.clear();
        self.light.clear();
        self.mask.clear();
        self.dirs.clear();
        self.dirs.extend(marches.iter().map(|m| <[f32; 3]>::from(m.dir.map(|d| d as f32))));
        self.image_points.clear();
        for r in 0..n_rays {
            let i = pixel(r);
            let lit = pixels.is_lit[drawn[r]];
            self.measured.extend(m.p[i * k..(i + 1) * k].iter().map(|p| if lit { *p } else { 0.0 }));
            let light = &m.light[i * self.n_channels..(i + 1) * self.n_channels];
            self.light.extend(light.iter().map(|l| l.max(0.0)));
            self.mask.push(f32::from(u8::from(lit)));
            self.image_points.push(image_point(m, i));
        }
    }

    /// Returns the number of samples.
    pub(super) fn n_samples(&self) -> usize {
        self.samples.t.len()
    }

    /// Takes one step of the optimizers; the cosine of the alphas is annealed by `anneal`, 0 to 1.
    pub(super) fn step(&self, surface: &mut NeuralSurface, ambient: &mut AmbientField, anneal: f32) -> SurfaceLosses {
        let (k, c) = (self.k, self.n_channels);
        let mut fractions = Vec::new();
        ambient.query(&self.image_points, &self.light, &mut fractions);
        // Every pattern has its channel's value.
        let n_rays = self.mask.len();
        let spread = |of: &[f32]| -> Vec<f32> {
            (0..n_rays).flat_map(|r| (0..k).map(move |j| (r, j))).map(|(r, j)| of[r * c + j % c]).collect()
        };
        let batch = SurfaceBatch {
            offsets: &self.samples.offsets,
            points: &self.samples.points,
            colors: &self.colors,
            measured: &self.measured,
            white: &spread(&self.light),
            ambient: &spread(&fractions),
            mask: &self.mask,
            intervals: Some(Intervals { lengths: &self.samples.lengths, dirs: &self.dirs, anneal }),
        };
        let mut d_spread = vec![0.0; n_rays * k];
        let losses = surface.train_step(&batch, &mut d_spread);
        let mut d_fractions = vec![0.0; n_rays * c];
        for (r, d) in d_spread.chunks_exact(k).enumerate() {
            for (j, d) in d.iter().enumerate() {
                d_fractions[r * c + j % c] += d;
            }
        }
        ambient.descend(&self.image_points, &self.light, &mut d_fractions);
        losses
    }
}
