//! A signed distance field that begins as the surface which a cost volume shows.
//!
//! c is frozen, so how badly each depth explains each pixel is known before any training. Recipe `fast` decodes a depth
//! map from that; here a field is fitted to it, so that training begins on the right period of every pattern.

use nalgebra::{Point3, Vector3};
use nelu3d_field::adam::Schedule;
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::field::{RegressionLoss, TrainConfig};
use nelu3d_field::surface::{NeuralSurface, SurfaceConfig};
use nelu3d_field::{HashField, HashFieldConfig};
use nelu3d_scan::Camera;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::bounds::Bounds;
use super::start::VALID;

/// Thickness of the body behind the decoded surface, units: what lies farther behind is free again, so that occupancy
/// empties there too.
const THICKNESS: f64 = 0.5;
/// Levels of the hash grid that learn the start: to 1.447^7 times the base, 213 cells. Finer ones would wrinkle it.
const LEVELS: usize = 8;
/// Nodes per axis of the coarse distances.
const NODES: usize = 33;
/// Surface points of the coarse distances.
const COARSE_POINTS: usize = 3000;

/// A decoded depth map as a body with a signed distance.
pub(super) struct DecodedBody<'a> {
    camera: &'a Camera,
    bounds: Bounds,
    /// Distance along the pixel's ray, mm; NaN where nothing was decoded.
    t: Vec<f32>,
    /// Unit directions of the pixels' rays.
    dirs: Vec<Vector3<f64>>,
    /// Cosine between the ray and the surface's normal, one per pixel.
    cosine: Vec<f32>,
    /// Pixels with a depth.
    lit: Vec<u32>,
    /// Distance to the surface at the nodes of a coarse grid, x fastest, units.
    coarse: Vec<f32>,
}

impl<'a> DecodedBody<'a> {
    /// Makes the body of a depth map, camera z in mm, NaN where there is none; `None` if it is empty.
    pub(super) fn new(camera: &'a Camera, bounds: Bounds, plane: &[[f32; 2]], depth: &[f32]) -> Option<Self> {
        let dirs: Vec<Vector3<f64>> =
            plane.iter().map(|[u, v]| Vector3::new(f64::from(*u), f64::from(*v), 1.0).normalize()).collect();
        let t: Vec<f32> = depth.iter().zip(&dirs).map(|(z, d)| z / d.z as f32).collect();
        let lit: Vec<u32> = (0..t.len() as u32).filter(|&i| t[i as usize].is_finite()).collect();
        if lit.is_empty() {
            return None;
        }
        let mut body = Self { camera, bounds, t, dirs, cosine: Vec::new(), lit, coarse: Vec::new() };
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

    /// Computes distances to the decoded points, whatever the side.
    fn coarse_distances(&self) -> Vec<f32> {
        let every = self.lit.len().div_ceil(COARSE_POINTS);
        let points: Vec<[f32; 3]> =
            self.lit.iter().step_by(every).map(|&i| self.bounds.to_cube(&self.point(i as usize))).collect();
        let side = super::bounds::SIDE as f32;
        let node = |i: usize| [i % NODES, i / NODES % NODES, i / NODES / NODES].map(|n| n as f32 / (NODES - 1) as f32);
        (0..NODES.pow(3))
            .into_par_iter()
            .map(|i| {
                let q = node(i);
                let square = |p: &[f32; 3]| (0..3).map(|a| (p[a] - q[a]) * (p[a] - q[a])).sum::<f32>();
                side * points.iter().map(square).fold(f32::INFINITY, f32::min).sqrt()
            })
            .collect()
    }

    /// Returns the distance to the surface, whatever the side, units: interpolated, so good to about a tenth.
    fn coarse_at(&self, q: [f32; 3]) -> f32 {
        let at = q.map(|q| q.clamp(0.0, 1.0) * (NODES - 1) as f32);
        let low = at.map(|p| (p as usize).min(NODES - 2));
        let mut sum = 0.0;
        for corner in 0..8 {
            let (mut weight, mut node, mut stride) = (1.0, 0, 1);
            for a in 0..3 {
                let upper = corner >> a & 1;
                let t = at[a] - low[a] as f32;
                weight *= if upper == 1 { t } else { 1.0 - t };
                node += (low[a] + upper) * stride;
                stride *= NODES;
            }
            sum += weight * self.coarse[node];
        }
        sum
    }

    /// Returns the signed distance at a point of the cube, units.
    fn distance(&self, q: [f32; 3]) -> f32 {
        let x = self.bounds.from_cube(q);
        let far = self.coarse_at(q);
        let pixel = self.camera.project(&x).and_then(|[u, v]| {
            let (u, v) = (u.round(), v.round());
            let inside = u >= 0.0 && v >= 0.0 && u < self.camera.width as f64 && v < self.camera.height as f64;
            inside.then(|| v as usize * self.camera.width + u as usize)
        });
        match pixel.filter(|&i| self.t[i].is_finite()) {
            // Beside the object everything is free.
            None => far,
            Some(i) => {
                let ahead = (f64::from(self.t[i]) - x.coords.norm()) / self.bounds.unit_mm;
                self.of_body(ahead * f64::from(self.cosine[i]), far)
            }
        }
    }

    /// Returns the signed distance of the body, given how far the surface lies ahead along its normal (negative:
    /// behind), and the distance to the nearest decoded point, units.
    fn of_body(&self, ahead: f64, nearest: f32) -> f32 {
        let ahead = ahead as f32;
        // The surface ahead may be far while another part of it is near.
        let front = if ahead.abs() < 0.1 { ahead } else { ahead.abs().min(nearest.max(0.1)).copysign(ahead) };
        front.max(-front - THICKNESS as f32)
    }

    /// Draws points and their signed distances: half of them near the surface, half anywhere.
    fn draw(&self, n: usize, rng: &mut StdRng) -> (Vec<[f32; 3]>, Vec<f32>) {
        let mut points = Vec::with_capacity(n);
        let mut targets = Vec::with_capacity(n);
        while points.len() < n {
            if points.len() % 2 == 0 {
                let q: [f32; 3] = std::array::from_fn(|_| rng.random());
                points.push(q);
                targets.push(self.distance(q));
                continue;
            }
            let i = self.lit[rng.random_range(0..self.lit.len())] as usize;
            // Dense near the surface, up to a fifth of a unit away.
            let u: f64 = rng.random_range(-1.0..1.0);
            let away = 0.2 * u * u.abs();
            let x = Point3::from(self.dirs[i] * (f64::from(self.t[i]) + away * self.bounds.unit_mm));
            points.push(self.bounds.to_cube(&x));
            targets.push(self.of_body(-away * f64::from(self.cosine[i]), away.abs() as f32));
        }
        (points, targets)
    }

    /// Fits a surface to the body: the coarse levels of the hash table and the network learn it; fine levels begin as
    /// small as ever.
    pub(super) fn surface(&self, config: SurfaceConfig, seed: u64) -> NeuralSurface {
        const STEPS: u64 = 600;
        const POINTS: usize = 4096;
        let training = TrainConfig {
            loss: RegressionLoss::Huber { delta: 0.05 },
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
        let mut coarse =
            HashField::new(HashFieldConfig { encoding, training, ..config.field.clone() }, seed).expect(VALID);
        let mut rng = StdRng::seed_from_u64(seed);
        for _ in 0..STEPS {
            let (points, targets) = self.draw(POINTS, &mut rng);
            coarse.train_step(&points, &targets, &[]);
        }
        let params = widen(&coarse, &whole);
        NeuralSurface::from_params(config, params).expect(VALID)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A bump before a camera, on a part of the image.
    #[test]
    fn a_surface_starts_as_the_decoded_body() {
        let camera = Camera::pinhole(64, 48, 80.0, 80.0, 31.5, 23.5);
        let plane: Vec<[f32; 2]> =
            (0..64 * 48).map(|i| camera.undistort([(i % 64) as f64, (i / 64) as f64]).map(|v| v as f32)).collect();
        let depth: Vec<f32> = plane
            .iter()
            .map(|[u, v]| if u.hypot(*v) < 0.2 { 500.0 - 40.0 * (-60.0 * (u * u + v * v)).exp() } else { f32::NAN })
            .collect();
        let bounds = Bounds { center: Point3::new(0.0, 0.0, 490.0), unit_mm: 100.0 };
        let body = DecodedBody::new(&camera, bounds, &plane, &depth).unwrap();
        let mut config = super::super::config::surface_config(Default::default(), 100);
        config.field.encoding.log2_hashmap_size = 14;
        let surface = body.surface(config, 3);
        let at = |i: usize, away: f64| bounds.to_cube(&Point3::from(body.dirs[i] * (f64::from(body.t[i]) + away)));
        let mut points = Vec::new();
        for &i in &body.lit {
            points.extend([at(i as usize, 0.0), at(i as usize, -10.0), at(i as usize, 10.0), at(i as usize, 80.0)]);
        }
        let mut found = vec![0.0; points.len()];
        surface.field().query(&points, &mut found);
        let n = body.lit.len() as f32;
        let mean = |k: usize| found.iter().skip(k).step_by(4).sum::<f32>() / n;
        let error = found.iter().step_by(4).map(|f| f.abs()).sum::<f32>() / n;
        // Units of 100 mm: half a millimeter on the surface, a tenth of a unit on either side, free far behind.
        assert!(error < 0.005, "{error}");
        assert!((mean(1) - 0.09).abs() < 0.03 && (mean(2) + 0.09).abs() < 0.03, "{} {}", mean(1), mean(2));
        assert!(mean(3) > 0.1, "{}", mean(3));
        // Beside the object nothing is in the way.
        let beside: Vec<[f32; 3]> = (0..20).map(|j| [0.9, 0.5, j as f32 / 19.0]).collect();
        let mut found = vec![0.0; 20];
        surface.field().query(&beside, &mut found);
        assert!(found.iter().all(|f| *f > 0.1), "{found:?}");
        assert!(DecodedBody::new(&camera, bounds, &plane, &vec![f32::NAN; 64 * 48]).is_none());
    }
}
