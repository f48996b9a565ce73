//! Pixels on a board: where they are in space, and what they measured.

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::board::Corner;
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Camera, rig::Capture};

use crate::calibrate::BoardPlane;
use crate::color_field::{ColorField, grid::Grid};
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Most pixels that are looked at, and about how many of those on the board are compared.
const MAX_PIXELS: usize = 400_000;
const MAX_SAMPLES: usize = 3000;
/// Fewest samples that tell something.
const MIN_SAMPLES: usize = 150;
/// Reach of a corner over the board, as a part of the typical distance to its neighbor: what is nearer than this to a
/// corner that was found is board, not something before it.
const REACH: f64 = 0.7;
/// Smallest standard deviation of the field itself, normalized intensity.
const MODEL_SIGMA: f32 = 0.005;
/// χ² per measurement beyond which a pixel shows something else than the board.
pub(super) const OUTLIER: f64 = 12.0;

/// Well-lit pixels on the paper of a board.
pub(super) struct BoardSamples {
    /// Points on the board's plane in the camera's frame, mm.
    pub(super) points: Vec<Point3<f64>>,
    /// Number of channels.
    pub(super) k: usize,
    /// Measured codewords, `n × k`.
    pub(super) p: Vec<f32>,
    /// One over their variances, `n × k`.
    pub(super) inv_var: Vec<f32>,
    /// Unit normal of the board's plane, camera frame.
    normal: Vector3<f64>,
    /// Distance of the plane from the camera along the normal, mm.
    offset: f64,
}

impl BoardSamples {
    /// Samples a board around its `corners`; `None` where too little of it is lit within the calibrated
    /// volume.
    pub(super) fn new(
        capture: &Capture,
        camera: &Camera,
        plane: &BoardPlane,
        corners: &[Corner],
        field: &ColorField,
    ) -> Option<Self> {
        let metadata = &field.metadata;
        let size = [camera.width, camera.height];
        let m = Measurements::new(capture, size, &metadata.noise, &metadata.dark, metadata.model_sigma(MODEL_SIGMA));
        let reach = REACH * spacing(corners)?;
        let on_board = |i: usize| {
            let dir = camera.ray([(i % m.width) as f64, (i / m.width) as f64]).dir;
            let x = Point3::from(dir * plane.hit(&dir)?);
            let at = plane.printed(&x);
            let near = |c: &Corner| (c.board_mm[0] - at[0]).hypot(c.board_mm[1] - at[1]) < reach;
            let lit = || field.frame.to_unit(&x).is_some_and(|q| field.validity.is_lit(q));
            (m.status[i] == PixelStatus::Valid && corners.iter().any(near) && lit()).then_some((i, x))
        };
        let stride = ((m.n() as f64 / MAX_PIXELS as f64).sqrt().ceil() as usize).max(1);
        let pixels = (0..m.height).step_by(stride).flat_map(|y| (0..m.width).step_by(stride).map(move |x| (x, y)));
        let all: Vec<_> = pixels.filter_map(|(x, y)| on_board(y * m.width + x)).collect();
        // Ink tells little.
        let mut contrast: Vec<f32> = all.iter().map(|(i, _)| m.contrast[*i]).collect();
        contrast.sort_by(f32::total_cmp);
        let paper = 0.5 * contrast.get(contrast.len() * 9 / 10)?;
        let lit: Vec<_> = all.into_iter().filter(|(i, _)| m.contrast[*i] > paper).collect();
        let which: Vec<_> = lit.iter().step_by((lit.len() / MAX_SAMPLES).max(1)).collect();
        let of = |values: &[f32]| which.iter().flat_map(|(i, _)| values[i * m.k..(i + 1) * m.k].to_vec()).collect();
        (which.len() >= MIN_SAMPLES).then(|| Self {
            points: which.iter().map(|w| w.1).collect(),
            k: m.k,
            p: of(&m.p),
            inv_var: of(&m.inv_var),
            normal: plane.normal,
            offset: plane.offset,
        })
    }

    /// Returns χ² per measurement of sample `i` if it shows the codeword `c`.
    pub(super) fn misfit(&self, i: usize, c: &[f32]) -> f64 {
        let own = i * self.k..(i + 1) * self.k;
        let squares = self.p[own.clone()].iter().zip(&self.inv_var[own]).zip(c);
        squares.map(|((p, w), c)| f64::from(w * (p - c) * (p - c))).sum::<f64>() / self.k as f64
    }

    /// Returns χ² per measurement of every `stride`-th sample if each point x of the board shows what the field has at
    /// `then · x`.
    pub(super) fn misfits(&self, field: &ColorField, grid: &Grid, then: &Isometry3<f64>, stride: usize) -> Vec<f64> {
        let mut c = vec![0.0; self.k];
        let misfit = |i: usize| match field.frame.to_unit(&(then * self.points[i])) {
            Some(q) if q.iter().all(|v| (0.0..=1.0).contains(v)) => {
                grid.eval(q, &mut c);
                self.misfit(i, &c)
            }
            _ => f64::INFINITY,
        };
        (0..self.points.len()).step_by(stride).map(misfit).collect()
    }

    /// Returns how far the pattern moved on the board in every sample, seen by the camera, px, if the light moved so.
    pub(super) fn shifts_px(&self, field: &ColorField, camera: &Camera, motion: &Isometry3<f64>) -> Vec<[f64; 2]> {
        let along = |x: &Point3<f64>| match field.frame.center() {
            Some(center) => x - center,
            None => Vector3::from(field.frame.axes[2]),
        };
        let shift = |x: &Point3<f64>| {
            // The ray of light through x, moved, meets the board elsewhere.
            let (moved, dir) = (motion * x, motion * along(x));
            let back = (self.offset - self.normal.dot(&moved.coords)) / self.normal.dot(&dir);
            let (a, b) = (camera.project(x)?, camera.project(&(moved + dir * back))?);
            Some([b[0] - a[0], b[1] - a[1]])
        };
        self.points.iter().filter_map(shift).collect()
    }
}

/// Returns the median distance from a corner to the next, mm.
fn spacing(corners: &[Corner]) -> Option<f64> {
    let distance = |a: &Corner, b: &Corner| (a.board_mm[0] - b.board_mm[0]).hypot(a.board_mm[1] - b.board_mm[1]);
    let next = |a: &Corner| corners.iter().map(|b| distance(a, b)).filter(|d| *d > 1e-6).min_by(f64::total_cmp);
    median(&mut corners.iter().filter_map(next).collect::<Vec<_>>())
}
