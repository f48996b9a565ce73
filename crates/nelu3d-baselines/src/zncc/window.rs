//! The window search: correlations of a pixel's surroundings, summed at equal inverse depth.

use nalgebra::{Matrix3, Vector3};
use nelu3d::surface::PixelStatus;
use rayon::prelude::*;

use super::codewords::{CodewordTable, SeenCodewords};
use super::refine::{Refiner, model_variance};
use super::window_sums::WindowSums;
use crate::captured::Captured;
use crate::code::AxisCode;
use crate::triangulate::{Along, Geometry};

/// Projector px between two depth hypotheses (inverse depths) of the window search.
const HYPOTHESIS_PX: f32 = 0.5;

/// Most depth hypotheses of the window search.
const MAX_HYPOTHESES: usize = 4096;

/// Rows that are summed together; fixed, so that sums do not depend on the number of threads.
const BAND: usize = 48;

/// What the window search works on: one axis of a code.
pub(super) struct WindowSearch<'a> {
    pub(super) seen: &'a SeenCodewords,
    pub(super) table: &'a CodewordTable,
    pub(super) axis: &'a AxisCode,
    pub(super) geometry: &'a Geometry<'a>,
    pub(super) captured: &'a Captured,
    /// Smallest correlation of a window that is believed.
    pub(super) min_score: f32,
    /// Half the window's side, less the middle, px.
    pub(super) radius: usize,
}

impl WindowSearch<'_> {
    /// Finds the best inverse depth of every pixel's window; returns the columns there, and their standard deviations.
    pub(super) fn run(&self, status: &mut [PixelStatus]) -> (Vec<f32>, Vec<f32>) {
        let (geometry, axis) = (self.geometry, self.axis);
        let hypotheses =
            ((geometry.longest_interval(axis.axis) / HYPOTHESIS_PX).ceil() as usize + 1).clamp(2, MAX_HYPOTHESES);
        let along: Vec<Option<Along>> = (0..self.captured.status.len())
            .into_par_iter()
            .map(|i| (self.captured.status[i] == PixelStatus::Valid).then(|| geometry.along(i, axis.axis)).flatten())
            .collect();
        let best = self.best_hypotheses(&along, hypotheses);
        let refined = self.refine_pixels(&along, &best);
        let planes = PlaneFit {
            search: self,
            along: &along,
            best: &best,
            refined: &refined,
            gate: 3.0 / (hypotheses - 1) as f32,
        };
        let one = |(i, status): (usize, &mut PixelStatus)| match planes.fit(i) {
            Ok(found) => found,
            Err(why) => {
                *status = why;
                (f32::NAN, f32::NAN)
            }
        };
        let found: Vec<(f32, f32)> = status.par_iter_mut().enumerate().map(one).collect();
        found.into_iter().unzip()
    }

    /// Finds the best inverse depth of every pixel's window, as s in 0 to 1, and its correlation, band by band.
    fn best_hypotheses(&self, along: &[Option<Along>], hypotheses: usize) -> Vec<(f32, f32)> {
        let (w, h, radius) = (self.captured.width, self.captured.height, self.radius);
        let bands: Vec<Vec<(f32, f32)>> = (0..h.div_ceil(BAND))
            .into_par_iter()
            .map(|band| {
                let rows = band * BAND..((band + 1) * BAND).min(h);
                let mut sums = WindowSums::new(self.seen, self.table, along, w, hypotheses, radius);
                let mut out = Vec::with_capacity(rows.len() * w);
                for y in rows.start.saturating_sub(radius)..(rows.start + radius).min(h) {
                    sums.add(y);
                }
                for y in rows {
                    if y + radius < h {
                        sums.add(y + radius);
                    }
                    if y > radius {
                        sums.remove(y - radius - 1);
                    }
                    out.extend((0..w).map(|x| sums.best(x)));
                }
                out
            })
            .collect();
        bands.into_iter().flatten().collect()
    }

    /// Refines each pixel by itself, near its window's column; returns s and its standard deviation.
    fn refine_pixels(&self, along: &[Option<Along>], best: &[(f32, f32)]) -> Vec<(f32, f32)> {
        let k = self.seen.k;
        let one = |refiner: &mut Refiner, i: usize| {
            let Some(a) = &along[i] else { return (f32::NAN, f32::NAN) };
            let s = best[i].0;
            let noise = self.captured.variance(i, 0.5) + model_variance(k);
            let slope = a.slope(s).abs().max(1e-3);
            match refiner.refine(self.table, self.seen.at(i), a.at(s), noise) {
                Some((u, sigma)) => (a.inverse(u), sigma / slope),
                None => (f32::NAN, f32::NAN),
            }
        };
        (0..along.len()).into_par_iter().map_init(|| Refiner::new(k), one).collect()
    }
}

/// The last step of the window search: a plane in inverse depth through the window's pixels that belong together.
struct PlaneFit<'a> {
    search: &'a WindowSearch<'a>,
    along: &'a [Option<Along>],
    /// Per pixel the best s of its window, and its correlation.
    best: &'a [(f32, f32)],
    /// Per pixel its own s, and its standard deviation.
    refined: &'a [(f32, f32)],
    /// Pixels whose s differ by more do not belong together.
    gate: f32,
}

impl PlaneFit<'_> {
    /// Fits the plane around pixel `i`; returns the column in its middle and its standard deviation, or why there is
    /// none.
    fn fit(&self, i: usize) -> Result<(f32, f32), PixelStatus> {
        let WindowSearch { captured, axis, min_score, .. } = *self.search;
        let Some(a) = &self.along[i] else {
            return Err(if captured.status[i] == PixelStatus::Valid {
                PixelStatus::OutsideVolume
            } else {
                captured.status[i]
            });
        };
        let (s, score) = self.best[i];
        if score.is_nan() || score < min_score {
            return Err(PixelStatus::Ambiguous);
        }
        let fitted = self.solve(i, s).filter(|f| f.0.abs() <= self.gate && f.1.is_finite());
        let (offset, sigma) = fitted.ok_or(PixelStatus::Ambiguous)?;
        let u = a.at(s + offset);
        if !(u >= -0.5 && u <= axis.len() as f32 - 0.5) {
            return Err(PixelStatus::OutsideVolume);
        }
        Ok((u, sigma * a.slope(s).abs()))
    }

    /// Weighted least squares over the window; returns the plane's height over `s` at pixel `i` and its standard
    /// deviation.
    fn solve(&self, i: usize, s: f32) -> Option<(f32, f32)> {
        let (gate, radius) = (self.gate, self.search.radius);
        let (w, h) = (self.search.captured.width, self.search.captured.height);
        let (x, y) = (i % w, i / w);
        let mut normal = Matrix3::<f32>::zeros();
        let mut rhs = Vector3::<f32>::zeros();
        let mut n = 0;
        for yy in y.saturating_sub(radius)..(y + radius + 1).min(h) {
            for xx in x.saturating_sub(radius)..(x + radius + 1).min(w) {
                let j = yy * w + xx;
                let (v, sigma) = self.refined[j];
                if !v.is_finite() || (v - s).abs() > gate * (1 + radius) as f32 || (self.best[j].0 - s).abs() > gate {
                    continue;
                }
                let weight = 1.0 / (sigma * sigma);
                let row = Vector3::new(1.0, xx as f32 - x as f32, yy as f32 - y as f32);
                normal += row * row.transpose() * weight;
                rhs += row * (weight * (v - s));
                n += 1;
            }
        }
        if n < 6 {
            return None;
        }
        normal.try_inverse().map(|m| ((m * rhs)[0], m[(0, 0)].max(0.0).sqrt()))
    }
}
