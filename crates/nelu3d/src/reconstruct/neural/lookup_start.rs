//! A signed distance field that begins as the surface which a cost volume shows.
//!
//! c is frozen, so how badly each depth explains each pixel is known before any training. Recipe `fast` decodes a depth
//! map from that; here a field is fitted to it, so that training begins on the right period of every pattern.

use nalgebra::{Point3, Vector3};
use nelu3d_field::adam::Schedule;
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::field::TrainConfig;
use nelu3d_field::surface::{NeuralSurface, RayGradient, RayLoss, RayScratch, SurfaceConfig, SurfaceLoss};
use nelu3d_field::{HashField, HashFieldConfig};
use nelu3d_scan::Camera;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::bounds::{Bounds, SIDE};
use super::distances::signed_distances;
use super::start::VALID;

/// Thickness of the body behind the decoded surface, units: what lies farther behind is free again, so that occupancy
/// empties there too.
const THICKNESS: f32 = 0.2;
/// Levels of the hash grid that learn the start: to 1.447^9 times the base, 446 cells: about a pixel, so that the
/// outline is where the image has it. Finer ones would wrinkle it.
const LEVELS: usize = 10;
/// Cells per axis of the coarse distances.
const CELLS: usize = 128;

/// Distance to the outline up to which a pixel is at it, px.
const EDGE_PX: f32 = 3.0;

/// What the camera sees in the direction of a point.
#[derive(Clone, Copy)]
struct Seen {
    /// How far the surface lies ahead along its normal, units; negative if it is behind; NaN if there is none.
    ahead: f32,
    /// Distance to the outline across the ray, units; negative within it.
    aside: f32,
}

impl Seen {
    /// Returns whether the point lies in the body.
    fn is_inside(self) -> bool {
        self.ahead < 0.0 && self.ahead > -THICKNESS
    }
}

/// A decoded depth map as a body with a signed distance.
pub struct DecodedBody<'a> {
    camera: &'a Camera,
    bounds: Bounds,
    /// Distance along the pixel's ray, mm; NaN where nothing was decoded.
    pub t: Vec<f32>,
    /// Unit directions of the pixels' rays.
    pub dirs: Vec<Vector3<f64>>,
    /// Cosine between the ray and the surface's normal, one per pixel.
    cosine: Vec<f32>,
    /// Pixels with a depth.
    pub lit: Vec<u32>,
    /// Those of them that are near one without.
    edge: Vec<u32>,
    /// Distances in the image to the outline of what was decoded, px; negative within it.
    pub outline: Vec<f32>,
    /// Signed distance at the centers of coarse cells, x fastest, units; good to half a cell.
    coarse: Vec<f32>,
}

impl<'a> DecodedBody<'a> {
    /// Makes the body of a depth map, camera z in mm, NaN where there is none; `None` if it is empty.
    pub fn new(camera: &'a Camera, bounds: Bounds, plane: &[[f32; 2]], depth: &[f32]) -> Option<Self> {
        let dirs: Vec<Vector3<f64>> =
            plane.iter().map(|[u, v]| Vector3::new(f64::from(*u), f64::from(*v), 1.0).normalize()).collect();
        let t: Vec<f32> = depth.iter().zip(&dirs).map(|(z, d)| z / d.z as f32).collect();
        let lit: Vec<u32> = (0..t.len() as u32).filter(|&i| t[i as usize].is_finite()).collect();
        if lit.is_empty() {
            return None;
        }
        let size = [camera.width, camera.height];
        let is_lit: Vec<bool> = t.iter().map(|t| t.is_finite()).collect();
        let outline = signed_distances(&is_lit, &size);
        let edge: Vec<u32> = lit.iter().copied().filter(|&i| outline[i as usize] > -EDGE_PX).collect();
        let mut body = Self { camera, bounds, t, dirs, cosine: Vec::new(), lit, edge, outline, coarse: Vec::new() };
        body.cosine = (0..depth.len()).map(|i| body.cosine_at(i)).collect();
        body.coarse = body.coarse_distances();
        Some(body)
    }

    /// Returns the decoded point of a pixel, mm.
    fn point(&self, i: usize) -> Point3<f64> {
        Point3::from(self.dirs[i] * f64::from(self.t[i]))
    }

    /// Returns the cosine between a pixel's ray and the normal of the surface through it and its neighbors; 1 where
    /// these have no depth or lie on another surface.
    fn cosine_at(&self, i: usize) -> f32 {
        let (w, h) = (self.camera.width, self.camera.height);
        let (x, y) = (i % w, i / w);
        if !self.t[i].is_finite() || x + 1 >= w || y + 1 >= h {
            return 1.0;
        }
        // A step that is steeper than 80° is another surface.
        let pixel_mm = f64::from(self.t[i]) / (0.5 * (self.camera.fx + self.camera.fy));
        let toward = |j: usize| {
            let d = self.point(j) - self.point(i);
            (d.norm() < 6.0 * pixel_mm).then_some(d)
        };
        let (Some(right), Some(down)) = (toward(i + 1), toward(i + w)) else { return 1.0 };
        (right.cross(&down).normalize().dot(&self.dirs[i]).abs() as f32).max(0.17)
    }

    /// Returns what the camera sees in the direction of a point of the cube; `None` beside the image.
    fn seen(&self, q: [f32; 3]) -> Option<Seen> {
        let x = self.bounds.from_cube(q);
        let [u, v] = self.camera.project(&x)?.map(f64::round);
        let inside = u >= 0.0 && v >= 0.0 && u < self.camera.width as f64 && v < self.camera.height as f64;
        let i = inside.then(|| v as usize * self.camera.width + u as usize)?;
        let ahead = (f64::from(self.t[i]) - x.coords.norm()) / self.bounds.unit_mm * f64::from(self.cosine[i]);
        let pixel = x.z / (0.5 * (self.camera.fx + self.camera.fy)) / self.bounds.unit_mm;
        Some(Seen { ahead: ahead as f32, aside: self.outline[i] * pixel as f32 })
    }

    /// Computes the signed distances of the coarse cells to the body: what lies behind a decoded surface, up to its
    /// thickness. Everything else is free.
    fn coarse_distances(&self) -> Vec<f32> {
        let cells: Vec<u32> = (0..CELLS.pow(3) as u32).collect();
        let inside: Vec<bool> =
            cells.into_par_iter().map(|c| self.seen(center(c)).is_some_and(|s| s.is_inside())).collect();
        let cell = SIDE as f32 / CELLS as f32;
        signed_distances(&inside, &[CELLS; 3]).into_iter().map(|d| d * cell).collect()
    }

    /// Returns the coarse signed distance at a point of the cube, units, interpolated.
    fn coarse_at(&self, q: [f32; 3]) -> f32 {
        let at = q.map(|q| (q * CELLS as f32 - 0.5).clamp(0.0, (CELLS - 1) as f32));
        let low = at.map(|p| (p as usize).min(CELLS - 2));
        let mut sum = 0.0;
        for corner in 0..8 {
            let (mut weight, mut node, mut stride) = (1.0, 0, 1);
            for a in 0..3 {
                let upper = corner >> a & 1;
                let t = at[a] - low[a] as f32;
                weight *= if upper == 1 { t } else { 1.0 - t };
                node += (low[a] + upper) * stride;
                stride *= CELLS;
            }
            sum += weight * self.coarse[node];
        }
        sum
    }

    /// Returns the signed distance at a point of the cube, units: the coarse one, or, where the surface that the pixel
    /// shows or the outline is as near as anything, that to these.
    fn distance(&self, q: [f32; 3]) -> f32 {
        let coarse = self.coarse_at(q);
        let cell = SIDE as f32 / CELLS as f32;
        match self.seen(q) {
            Some(seen) if seen.is_inside() => {
                // Steps within the object are known to half a cell only.
                let near = seen.ahead.max(seen.aside).max(-THICKNESS - seen.ahead);
                if near < coarse - cell { coarse.min(0.0) } else { near }
            }
            // Beside the object everything is free.
            Some(seen) if seen.aside > 0.0 => coarse.max(seen.aside),
            Some(seen) if seen.ahead >= 0.0 && seen.ahead < coarse.abs() + cell => seen.ahead,
            _ => coarse.max(0.0),
        }
    }

    /// Draws points and their signed distances: half of them along the rays near the surface, a quarter around the
    /// outline, a quarter anywhere.
    fn draw(&self, n: usize, rng: &mut StdRng) -> (Vec<[f32; 3]>, Vec<f32>) {
        let points: Vec<[f32; 3]> = (0..n)
            .map(|j| match j % 4 {
                0 => std::array::from_fn(|_| rng.random()),
                1 if !self.edge.is_empty() => self.draw_at_outline(rng),
                _ => self.draw_at_surface(rng),
            })
            .collect();
        let targets = points.par_iter().map(|q| self.distance(*q)).collect();
        (points, targets)
    }

    /// Draws a point on the ray of a decoded pixel, dense near the surface, up to a fifth of a unit away.
    fn draw_at_surface(&self, rng: &mut StdRng) -> [f32; 3] {
        let i = self.lit[rng.random_range(0..self.lit.len())] as usize;
        let u: f64 = rng.random_range(-1.0..1.0);
        let away = 0.2 * u * u.abs() * self.bounds.unit_mm;
        self.bounds.to_cube(&Point3::from(self.dirs[i] * (f64::from(self.t[i]) + away)))
    }

    /// Draws a point around the outline, before or behind the surface.
    fn draw_at_outline(&self, rng: &mut StdRng) -> [f32; 3] {
        let i = self.edge[rng.random_range(0..self.edge.len())] as usize;
        let (w, h) = (self.camera.width, self.camera.height);
        let mut aside = |at: usize, n: usize| {
            let to = at as f64 + rng.random_range(-2.0..2.0) * f64::from(EDGE_PX);
            to.round().clamp(0.0, n as f64 - 1.0) as usize
        };
        let (x, y) = (aside(i % w, w), aside(i / w, h));
        let away = rng.random_range(-0.1..f64::from(THICKNESS) + 0.1) * self.bounds.unit_mm;
        self.bounds.to_cube(&Point3::from(self.dirs[y * w + x] * (f64::from(self.t[i]) + away)))
    }

    /// Returns v of the sharpness exp(10 v), per unit, of a surface that is as soft as a pixel is wide.
    pub(super) fn sharpness(&self) -> f64 {
        let mut z: Vec<f64> = self.lit.iter().map(|&i| self.point(i as usize).z).collect();
        let middle = z.len() / 2;
        let (_, z, _) = z.select_nth_unstable_by(middle, f64::total_cmp);
        0.1 * (self.bounds.unit_mm * 0.5 * (self.camera.fx + self.camera.fy) / *z).ln()
    }

    /// Fits a surface to the body: the coarse levels of the hash table and the network learn it, with slopes of length
    /// 1 as the training asks for them; fine levels begin as small as ever.
    pub fn surface(&self, config: SurfaceConfig, seed: u64) -> NeuralSurface {
        const STEPS: u64 = 600;
        const POINTS: usize = 4096;
        let training = TrainConfig {
            encoding_learning_rate: 1e-2,
            network_learning_rate: 5e-3,
            schedule: Schedule { n_warmup_steps: 20, n_steps: STEPS, final_factor: 0.02, ..Default::default() },
            weight_normalization: false,
            ..config.field.training.clone()
        };
        let published = &config.field.encoding;
        let n_levels = LEVELS.min(published.n_levels);
        let whole = HashField::new(config.field.clone(), seed).expect(VALID);
        let encoding = HashGridConfig {
            n_levels,
            finest_resolution: whole.levels()[n_levels - 1].resolution,
            ..published.clone()
        };
        let field = HashFieldConfig { encoding, training, ..config.field.clone() };
        let loss = SurfaceLoss { sparsity_weight: 0.0, ..SurfaceLoss::default() };
        let settings = SurfaceConfig { field, sharpness_learning_rate: 0.0, loss, ..config.clone() };
        let mut coarse = NeuralSurface::new(settings, seed).expect(VALID);
        let mut rng = StdRng::seed_from_u64(seed);
        let offsets: Vec<usize> = (0..=POINTS).collect();
        for _ in 0..STEPS {
            let (points, targets) = self.draw(POINTS, &mut rng);
            coarse.step(&offsets, &points, &KnownDistances(&targets), &mut [], &mut []);
        }
        let params = widen(coarse.field(), &whole);
        NeuralSurface::from_params(config, params).expect(VALID)
    }
}

/// Returns the center of a coarse cell, in the unit cube.
fn center(cell: u32) -> [f32; 3] {
    let n = CELLS as u32;
    [cell % n, cell / n % n, cell / n / n].map(|c| (c as f32 + 0.5) / n as f32)
}

/// The loss of a fit (Huber): every ray is one point, whose signed distance is known.
struct KnownDistances<'a>(&'a [f32]);

impl KnownDistances<'_> {
    /// Error up to which the loss is quadratic, units.
    const DELTA: f32 = 0.01;
}

impl RayLoss for KnownDistances<'_> {
    fn needs_gradients(&self) -> bool {
        false
    }

    fn n_ray_outputs(&self) -> usize {
        0
    }

    fn n_sample_outputs(&self) -> usize {
        0
    }

    fn ray(&self, r: usize, sdf: &[f32], _: &[[f32; 3]], _: f64, _: &mut RayScratch, out: RayGradient<'_>) {
        let n = self.0.len() as f32;
        let d = sdf[0] - self.0[r];
        out.d_sdf[0] = (d / Self::DELTA).clamp(-1.0, 1.0) / n;
        out.losses.image += f64::from(d.abs() / n);
    }
}

/// Returns the parameters of `whole` with those that `coarse`, which has fewer levels, shares with it.
fn widen(coarse: &HashField, whole: &HashField) -> Vec<f32> {
    let n_levels = coarse.levels().len();
    assert!(coarse.levels() == &whole.levels()[..n_levels], "levels of other resolutions");
    let mut params = whole.params().to_vec();
    let (n_coarse, n_whole) = (coarse.n_table_params(), whole.n_table_params());
    params[..n_coarse].copy_from_slice(&coarse.params()[..n_coarse]);
    let (from, to) = (&coarse.params()[n_coarse..], &mut params[n_whole..]);
    // The first layer's rows: features, then the position.
    let width = whole.config().width;
    let position = if whole.config().append_position { 3 } else { 0 };
    let features = |field: &HashField| field.config().encoding.n_levels * field.config().encoding.n_features_per_level;
    let (n_from, n_to) = (features(coarse), features(whole));
    for unit in 0..width {
        let (from, to) = (&from[unit * (n_from + position)..], &mut to[unit * (n_to + position)..]);
        to[..n_from].copy_from_slice(&from[..n_from]);
        to[n_to..n_to + position].copy_from_slice(&from[n_from..n_from + position]);
    }
    let (from, to) = (&from[width * (n_from + position)..], &mut to[width * (n_to + position)..]);
    to.copy_from_slice(from);
    params
}
