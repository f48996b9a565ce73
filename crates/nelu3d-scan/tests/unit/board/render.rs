//! Test images of boards whose pose is known: exact pixel areas, optical blur, uneven light, noise.

use nalgebra::{Isometry3, Matrix3, Vector3};
use nelu3d_scan::Camera;
use nelu3d_scan::board::Artwork;
use rayon::prelude::*;

/// How a board is seen.
pub(crate) struct View<'a> {
    pub(crate) artwork: &'a Artwork,
    pub(crate) camera: &'a Camera,
    pub(crate) cam_from_board: Isometry3<f64>,
    /// Outline (x0, y0, x1, y1) beyond which it is dark, mm; paper without end if there is none.
    pub(crate) outline_mm: Option<[f64; 4]>,
    /// Optical blur (Gaussian σ), px.
    pub(crate) blur_px: f64,
    /// Noise (Gaussian σ), of full scale.
    pub(crate) noise: f64,
    /// Steps of the sensor's codes; 0 for none.
    pub(crate) codes: f64,
    /// Seed of the noise.
    pub(crate) seed: u64,
}

/// Cells a pixel is divided into along each side.
const CELLS: usize = 4;
/// Levels of subdivision of a cell that an edge crosses.
const DEPTH: usize = 4;

impl View<'_> {
    /// Renders the linear image.
    pub(crate) fn render(&self) -> Vec<f32> {
        let (w, h) = (self.camera.width, self.camera.height);
        let coverage = self.coverage();
        let albedo = self.sense(&coverage);
        let mut rng = Gauss::new(self.seed);
        let mut image = vec![0.0f32; w * h];
        for y in 0..h {
            for x in 0..w {
                let albedo = f64::from(albedo[y * w + x]);
                // The light falls off to one side and toward the corners by almost half.
                let (u, v) = (x as f64 / w as f64 - 0.5, y as f64 / h as f64 - 0.5);
                let light = 0.7 * (1.0 - 0.35 * u - 0.2 * v) * (1.0 - 0.5 * (u * u + v * v));
                let value = light * (0.06 + 0.8 * albedo) + self.noise * rng.next();
                image[y * w + x] =
                    if self.codes > 0.0 { (value * self.codes).round() / self.codes } else { value } as f32;
            }
        }
        image
    }

    /// Returns what pixels see of the cells: their own area, blurred.
    fn sense(&self, coverage: &[f32]) -> Vec<f32> {
        let (w, h) = (self.camera.width, self.camera.height);
        let sigma = self.blur_px * CELLS as f64;
        let radius = (4.0 * sigma).ceil() as i64;
        let gauss = |i: i64| if sigma > 0.0 { (-0.5 * (i as f64 / sigma).powi(2)).exp() } else { f64::from(i == 0) };
        let reach = -radius..CELLS as i64 + radius;
        let weights: Vec<f64> = reach.clone().map(|i| (0..CELLS as i64).map(|c| gauss(i - c)).sum()).collect();
        let total: f64 = weights.iter().sum();
        let kernel: Vec<(i64, f32)> = reach.zip(weights.iter().map(|v| (v / total) as f32)).collect();
        let near = |pixel: usize, offset: i64, n: usize| {
            ((pixel * CELLS) as i64 + offset).clamp(0, (n * CELLS) as i64 - 1) as usize
        };
        let rows: Vec<f32> = (0..h * CELLS * w)
            .into_par_iter()
            .map(|i| {
                let row = &coverage[i / w * w * CELLS..][..w * CELLS];
                kernel.iter().map(|(o, k)| k * row[near(i % w, *o, w)]).sum()
            })
            .collect();
        (0..h * w)
            .into_par_iter()
            .map(|i| kernel.iter().map(|(o, k)| k * rows[near(i / w, *o, h) * w + i % w]).sum())
            .collect()
    }

    /// Returns the fraction of paper in each cell of the image.
    fn coverage(&self) -> Vec<f32> {
        let (w, h) = (self.camera.width, self.camera.height);
        let r = self.cam_from_board.rotation.to_rotation_matrix().into_inner();
        let t = self.cam_from_board.translation.vector;
        let plane_from_board = Matrix3::from_columns(&[r.column(0).into(), r.column(1).into(), t]);
        let board_from_plane = plane_from_board.try_inverse().unwrap();
        // Undistorted coordinates at the corners of all pixels; within a pixel they are as good as linear.
        let grid: Vec<[f64; 2]> = (0..(w + 1) * (h + 1))
            .into_par_iter()
            .map(|i| self.camera.undistort([(i % (w + 1)) as f64 - 0.5, (i / (w + 1)) as f64 - 0.5]))
            .collect();
        let albedo = |fx: f64, fy: f64| -> f32 {
            let (x, y) = ((fx as usize).min(w - 1), (fy as usize).min(h - 1));
            let (u, v) = (fx - x as f64, fy - y as f64);
            let g = |i: usize, j: usize| grid[(y + j) * (w + 1) + x + i];
            let p: [f64; 2] = std::array::from_fn(|k| {
                (1.0 - v) * ((1.0 - u) * g(0, 0)[k] + u * g(1, 0)[k]) + v * ((1.0 - u) * g(0, 1)[k] + u * g(1, 1)[k])
            });
            let b = board_from_plane * Vector3::new(p[0], p[1], 1.0);
            let (x, y) = (b.x / b.z, b.y / b.z);
            let is_beyond = |[x0, y0, x1, y1]: [f64; 4]| x < x0 || y < y0 || x > x1 || y > y1;
            if self.outline_mm.is_some_and(is_beyond) { 0.0 } else { self.artwork.albedo(x, y) }
        };
        let step = 1.0 / CELLS as f64;
        let stride = w * CELLS + 1;
        let corners: Vec<f32> = (0..stride * (h * CELLS + 1))
            .into_par_iter()
            .map(|i| albedo((i % stride) as f64 * step, (i / stride) as f64 * step))
            .collect();
        (0..w * CELLS * h * CELLS)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % (w * CELLS), i / (w * CELLS));
                let c = [0, 1, stride, stride + 1].map(|o| corners[y * stride + x + o]);
                area(&albedo, [x as f64 * step, y as f64 * step], step, c, DEPTH)
            })
            .collect()
    }
}

/// Returns the mean of a black-and-white function over a square, from its corners and, where they differ, its quarters.
fn area(f: &impl Fn(f64, f64) -> f32, [x, y]: [f64; 2], size: f64, c: [f32; 4], depth: usize) -> f32 {
    if depth == 0 || (c[0] == c[1] && c[1] == c[2] && c[2] == c[3]) {
        return 0.25 * c.iter().sum::<f32>();
    }
    let half = 0.5 * size;
    let (top, left, mid) = (f(x + half, y), f(x, y + half), f(x + half, y + half));
    let (right, bottom) = (f(x + size, y + half), f(x + half, y + size));
    0.25 * (area(f, [x, y], half, [c[0], top, left, mid], depth - 1)
        + area(f, [x + half, y], half, [top, c[1], mid, right], depth - 1)
        + area(f, [x, y + half], half, [left, mid, c[2], bottom], depth - 1)
        + area(f, [x + half, y + half], half, [mid, right, bottom, c[3]], depth - 1))
}

/// Normal variates (Box–Muller on a 64-bit generator), the same on every machine.
pub(crate) struct Gauss(u64);

impl Gauss {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x2545_f491_4f6c_dd1d)
    }

    /// Draws a number uniformly from (0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        // xorshift64*
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    pub(crate) fn next(&mut self) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}
