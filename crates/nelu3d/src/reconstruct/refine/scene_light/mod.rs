//! What changes codewords alike in a whole scene, and depends on how its surfaces stand and what color they have: a
//! flash beside the patterns' light (`flash.rs`), and crosstalk of a color camera (`colors.rs`).
//!
//! Both are small, half a percent of a codeword, and tell in thousands of pixels together. They are found by least
//! squares from what no depth of a pixel explains, with a constant factor of all light as a nuisance (boards that faced
//! elsewhere), in turns with depths and light fractions. Their errors are told by how much squares of the image
//! disagree: of what is not far beyond that, nothing is applied. That a part of the misfit is explained says little,
//! since most of it is noise.

mod colors;
mod flash;

use nalgebra::{DMatrix, DVector, Point3, Vector2};
use rayon::prelude::*;

use super::light_fractions::LightFractions;
use super::window::Window;
use crate::color_field::CameraRays;
use crate::sensor::{CrosstalkMatrix, Measurements};
use colors::Colors;
use flash::Flash;

/// Squares of the image across its width, which count as one sample each.
const SQUARES: usize = 16;
/// Fewest squares that tell anything.
const MIN_SQUARES: usize = 12;
/// One of so many pixels of a square that counts has a surface, at least.
const MIN_PART: usize = 8;
/// Most pixels that are looked at, about.
const MAX_PIXELS: usize = 20_000;
/// Squared parameters over their variance, per parameter, up to which nothing is applied; from twice that on all is.
/// By chance it is 1 where squares share no errors, but they do.
const BY_CHANCE: f64 = 12.0;
/// Prior standard deviations: of the flash's offset as a part of the distance to the light, of the constant factor, of
/// an entry of the crosstalk matrix.
const PRIOR: [f64; 3] = [0.05, 0.01, 0.1];
/// Pixels that share errors and count as one where they meet the prior.
const PIXELS_PER_SAMPLE: f64 = 50.0;

/// Parameters: two components of the flash's offset, the constant factor, six entries of the crosstalk matrix.
const N: usize = 9;
/// The parameters of gray cameras: without the matrix.
const N_GRAY: usize = 3;

/// What changes a scene's codewords.
pub(super) struct SceneLight<'a> {
    m: &'a Measurements,
    window: &'a Window,
    active: &'a [bool],
    flash: Option<Flash<'a>>,
    colors: Option<Colors>,
    /// One of so many pixels is looked at.
    every: usize,
}

/// Normal equations of the parameters, and the number of pixels in them.
struct Equations {
    a: [[f64; N]; N],
    b: [f64; N],
    n: usize,
}

/// Depths as of pixels of the window: 1/z, 1/mm, and its slopes along x and y, 1/mm per pixel.
pub(super) trait Depths: Fn(usize) -> (f32, [f32; 2]) + Sync {}
impl<F: Fn(usize) -> (f32, [f32; 2]) + Sync> Depths for F {}

impl<'a> SceneLight<'a> {
    /// Nothing is known yet. `light` is the patterns' light, mm, where it is known; `inv_z` the mean inverse depth,
    /// 1/mm; `board` the board's white − black per channel, where crosstalk may be looked for.
    pub(super) fn new(
        m: &'a Measurements,
        rays: &'a CameraRays,
        window: &'a Window,
        active: &'a [bool],
        (light, inv_z): (Option<Point3<f64>>, f32),
        board: Option<[f32; 3]>,
    ) -> Self {
        let flash = light.map(|light| Flash::new(rays, window, active, light, f64::from(inv_z)));
        let every = active.iter().filter(|a| **a).count() / MAX_PIXELS + 1;
        Self { m, window, active, flash, colors: board.map(Colors::new), every }
    }

    /// Changes rendered codewords and their slopes, `n × 2 k`, to what the scene's light makes of them.
    pub(super) fn change(&self, rendered: &mut [f32], depths: impl Depths) {
        let flash = self.flash.as_ref().filter(|f| f.applied != Vector2::zeros());
        let colors = self.colors.as_ref().filter(|c| c.is_applied());
        if flash.is_none() && colors.is_none() {
            return;
        }
        let (w, k) = (self.window.w, self.m.k);
        rendered.par_chunks_mut(2 * k * w).enumerate().for_each(|(y, row)| {
            for (x, rendered) in row.chunks_exact_mut(2 * k).enumerate().filter(|(x, _)| self.active[y * w + x]) {
                let i = y * w + x;
                if let Some(colors) = colors {
                    colors.change(self.m, self.window.at(i), rendered);
                }
                if let Some(flash) = flash {
                    let (inv_z, slope) = depths(i);
                    let factor = flash.factor(i, inv_z, slope);
                    rendered.iter_mut().for_each(|v| *v *= factor);
                }
            }
        });
    }

    /// Estimates all anew, where enough squares tell it. `rendered` has what is applied.
    pub(super) fn update(&mut self, rendered: &[f32], fractions: &LightFractions<'_>, depths: impl Depths) {
        if self.m.k < 3 || (self.flash.is_none() && self.colors.is_none()) {
            return;
        }
        let side = (self.m.image[0] / SQUARES).max(8);
        let [w, h] = [self.window.w, self.window.h];
        let squares = [w.div_ceil(side), h.div_ceil(side)];
        let of_square = |s: usize| {
            let [left, top] = [s % squares[0] * side, s / squares[0] * side];
            let mut sum = Equations { a: [[0.0; N]; N], b: [0.0; N], n: 0 };
            for y in top..(top + side).min(h) {
                let row = y * w + left..y * w + (left + side).min(w);
                for i in row.filter(|i| self.active[*i] && (*i + 3 * y) % self.every == 0) {
                    self.add(&mut sum, i, rendered, fractions, depths(i));
                }
            }
            sum
        };
        let sums: Vec<Equations> = (0..squares[0] * squares[1]).into_par_iter().map(of_square).collect();
        let told: Vec<&Equations> = sums.iter().filter(|s| s.n * self.every * MIN_PART > side * side).collect();
        if told.len() < MIN_SQUARES {
            return;
        }
        self.solve(&told);
    }

    /// Adds a pixel: what no change of its depth explains.
    fn add(
        &self,
        sum: &mut Equations,
        i: usize,
        rendered: &[f32],
        fractions: &LightFractions<'_>,
        (inv_z, slope): (f32, [f32; 2]),
    ) {
        let (m, k, px) = (self.m, self.m.k, self.window.at(i));
        let channels = m.light.len() / m.n();
        let n = if self.colors.is_some() { N } else { N_GRAY };
        let per_mm = match &self.flash {
            Some(flash) => match flash.per_mm(i, inv_z, slope) {
                Some(per_mm) => [per_mm.x as f32, per_mm.y as f32],
                None => return,
            },
            None => [0.0; 2],
        };
        let per_entry = self.colors.as_ref().map(|colors| colors.per_entry(m, px));
        let (mut a, mut b, mut with_depth) = ([[0.0f32; N]; N], [0.0f32; N], [0.0f32; N]);
        let (mut of_depth, mut depth_misfit, mut chi2) = (1e-9f32, 0.0f32, 0.0f32);
        for j in 0..k {
            let iv = m.inv_var[px * k + j];
            if iv == 0.0 {
                continue;
            }
            let direct = 1.0 - fractions.of_pixels[i * channels + j % channels].sum();
            let (c, d) = (rendered[i * 2 * k + j], direct * rendered[i * 2 * k + k + j]);
            let r = m.p[px * k + j] - fractions.explain(i, px, j, c);
            let mut by = [0.0f32; N];
            (by[0], by[1], by[2]) = (direct * c * per_mm[0], direct * c * per_mm[1], direct * c);
            if let Some(per_entry) = &per_entry {
                let image = i * 2 * k + j - j % 3;
                for (by, (channel, other, per)) in by[N_GRAY..].iter_mut().zip(per_entry) {
                    if *channel == j % 3 {
                        *by = direct * per * (rendered[image + other] - c);
                    }
                }
            }
            of_depth += iv * d * d;
            depth_misfit += iv * d * r;
            chi2 += iv * r * r;
            for p in (0..n).filter(|p| by[*p] != 0.0) {
                let v = iv * by[p];
                b[p] += v * r;
                with_depth[p] += v * d;
                (0..=p).for_each(|q| a[p][q] += v * by[q]);
            }
        }
        let weight = f64::from(fractions.weight(chi2));
        for p in 0..n {
            let part = with_depth[p] / of_depth;
            sum.b[p] += weight * f64::from(b[p] - part * depth_misfit);
            (0..=p).for_each(|q| sum.a[p][q] += weight * f64::from(a[p][q] - part * with_depth[q]));
        }
        sum.n += 1;
    }

    /// Solves the sums of squares, and applies what they agree on.
    fn solve(&mut self, squares: &[&Equations]) {
        let n = if self.colors.is_some() { N } else { N_GRAY };
        let matrix = |s: &Equations| DMatrix::from_fn(n, n, |p, q| s.a[p.max(q)][p.min(q)]);
        let vector = |s: &Equations| DVector::from_fn(n, |p, _| s.b[p]);
        let mut a: DMatrix<f64> = squares.iter().map(|s| matrix(s)).sum();
        let mut b: DVector<f64> = squares.iter().map(|s| vector(s)).sum();
        let mut applied = DVector::zeros(n);
        if let Some(flash) = &self.flash {
            applied.rows_mut(0, 2).copy_from(&flash.applied);
        }
        if let Some(colors) = &self.colors {
            applied.rows_mut(N_GRAY, 6).copy_from_slice(&colors.applied());
        }
        let distance = self.flash.as_ref().map_or(1.0, |f| f.distance);
        for p in 0..n {
            let sigma = match p {
                0 | 1 => PRIOR[0] * distance,
                2 => PRIOR[1],
                _ => PRIOR[2],
            };
            let weight = PIXELS_PER_SAMPLE / self.every as f64 / (sigma * sigma);
            a[(p, p)] += weight;
            b[p] -= weight * applied[p];
        }
        let Some(inverse) = a.try_inverse() else { return };
        let step = &inverse * b;
        let found = applied + &step;
        // What squares leave of their own equations: their disagreement, which neighboring pixels share.
        let left = squares.iter().map(|s| vector(s) - matrix(s) * &step);
        let spread: DMatrix<f64> = left.map(|s| &s * s.transpose()).sum();
        let variance = &inverse * spread * &inverse;
        let part = |first: usize, count: usize| {
            let found = found.rows(first, count).into_owned();
            let precision = variance.view((first, first), (count, count)).into_owned().try_inverse();
            let beyond = precision.map_or(0.0, |precision| found.dot(&(precision * &found)) / count as f64);
            tracing::debug!(found = ?found.as_slice(), beyond, squares = squares.len(), "light of the scene");
            if beyond > BY_CHANCE { found * (beyond / BY_CHANCE - 1.0).min(1.0) } else { DVector::zeros(count) }
        };
        if let Some(flash) = &mut self.flash {
            let offset = part(0, 2);
            flash.applied = Vector2::new(offset[0], offset[1]);
        }
        if let Some(colors) = &mut self.colors {
            let entries = part(N_GRAY, 6);
            colors.apply(std::array::from_fn(|i| entries[i]));
        }
    }

    /// Returns where the flash is from the patterns' light, mm in the camera's frame; `None` where that is not looked
    /// for.
    pub(super) fn flash_offset_mm(&self) -> Option<[f64; 3]> {
        self.flash.as_ref().map(|flash| flash.mm().into())
    }

    /// Returns the crosstalk matrix; `None` where none is looked for.
    pub(super) fn crosstalk(&self) -> Option<CrosstalkMatrix> {
        self.colors.as_ref().map(Colors::matrix)
    }
}
