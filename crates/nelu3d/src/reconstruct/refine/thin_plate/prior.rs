//! The prior itself: second differences of the surface and their weights.

use std::ops::Range;

use nelu3d_field::plate::PlateSystem;
use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

/// A discontinuity-preserving thin-plate prior over a rectangular window of pixels. Pixels with `active = false` take
/// no part. The outermost ring of pixels never does, so that no stencil leaves the window.
pub struct ThinPlatePrior {
    /// Width of the window.
    pub width: usize,
    /// Height of the window.
    pub(in crate::reconstruct::refine) height: usize,
    /// Pixels that are part of the surface.
    pub active: Vec<bool>,
    /// Weight of the second difference along x centered on a pixel (0 where a neighbor is missing).
    pub(super) wxx: Vec<f32>,
    /// Weight of the second difference along y, likewise.
    pub(super) wyy: Vec<f32>,
    /// Weight of the mixed difference over the 2 × 2 cell whose top-left pixel this is (counted twice, as in the thin
    /// plate).
    pub(super) wxy: Vec<f32>,
    /// Part of the floor's variance that counts at each pixel, [`LEAST_PART`] to 1.
    floor_part: Vec<f32>,
}

/// The least part of the floor's variance: second differences of a tenth. Depths gain nothing by stiffer plates.
const LEAST_PART: f32 = 0.01;
/// Largest factor by which a part changes at a time: where noise explains all that is seen, it may explain too much.
const MAX_CHANGE: f32 = 10.0;

impl ThinPlatePrior {
    /// A prior without weights.
    ///
    /// # Panics
    ///
    /// If a pixel of the outermost ring is active.
    pub fn new(width: usize, height: usize, active: Vec<bool>) -> Self {
        let n = width * height;
        assert_eq!(active.len(), n);
        let ring = |i: usize| [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width));
        assert!((0..n).all(|i| !(active[i] && ring(i))), "the outermost ring of the prior must be free");
        Self {
            width,
            height,
            active,
            wxx: vec![0.0; n],
            wyy: vec![0.0; n],
            wxy: vec![0.0; n],
            floor_part: vec![1.0; n],
        }
    }

    /// Returns the prior of some rows of its window, as if there were no others: the first and the last of them take no
    /// part.
    pub fn of_rows(&self, rows: Range<usize>) -> Self {
        let (w, h, start) = (self.width, rows.len(), rows.start * self.width);
        let mut active = vec![false; w * h];
        active[w..(h - 1) * w].copy_from_slice(&self.active[start + w..start + (h - 1) * w]);
        // Differences that reach into those two rows are missing.
        let weights = |of: &[f32], first: usize, end: usize| {
            let mut some = vec![0.0; w * h];
            if first < end {
                some[first * w..end * w].copy_from_slice(&of[start + first * w..start + end * w]);
            }
            some
        };
        let (wxx, wyy) = (weights(&self.wxx, 1, h - 1), weights(&self.wyy, 2, h.saturating_sub(2)));
        let wxy = weights(&self.wxy, 1, h.saturating_sub(2));
        let floor_part = self.floor_part[start..start + w * h].to_vec();
        Self { width: w, height: h, active, wxx, wyy, wxy, floor_part }
    }

    /// Returns which of the three second differences exist at pixel `i`.
    #[inline]
    fn exists(&self, i: usize) -> [bool; 3] {
        let (a, w) = (&self.active, self.width);
        if !a[i] {
            return [false; 3];
        }
        [a[i - 1] && a[i + 1], a[i - w] && a[i + w], a[i + 1] && a[i + w] && a[i + w + 1]]
    }

    /// Returns a second difference of `x` at pixel `i`, where it exists: along x (0), along y (1), mixed (2).
    #[inline]
    fn difference(&self, x: &[f32], i: usize, direction: usize) -> f32 {
        let w = self.width;
        match direction {
            0 => x[i - 1] - 2.0 * x[i] + x[i + 1],
            1 => x[i - w] - 2.0 * x[i] + x[i + w],
            _ => x[i] - x[i + 1] - x[i + w] + x[i + w + 1],
        }
    }

    /// Sets the weights of all differences from their values in `x`. A surface is smooth to a degree that varies from
    /// place to place: the weight is one over `floor²`, or the part of it that [`Self::scale_floor`] left, plus the local
    /// mean of squared differences (over a square of the given radius, each direction for itself). Differences beyond
    /// `crease` are creases or jumps: they do not count as roughness of their surroundings, and the prior breaks there.
    pub fn reweight(&mut self, x: &[f32], floor: f32, crease: f32, radius: usize) {
        let (w, h) = (self.width, self.height);
        let this = &*self;
        let weights: Vec<Vec<f32>> = (0..3)
            .into_par_iter()
            .map(|direction| {
                let exists = |i: usize| this.exists(i)[direction];
                let (mut sum, mut count) = (vec![0.0f32; w * h], vec![0.0f32; w * h]);
                for i in (0..w * h).filter(|i| exists(*i)) {
                    let d = this.difference(x, i, direction);
                    if d.abs() < crease {
                        sum[i] = d * d;
                        count[i] = 1.0;
                    }
                }
                box_mean(&mut sum, w, h, radius);
                box_mean(&mut count, w, h, radius);
                // The mixed difference counts twice, as in the thin plate.
                let multiplicity = if direction == 2 { 2.0 } else { 1.0 };
                for i in 0..w * h {
                    sum[i] = if exists(i) {
                        let mean = if count[i] > 0.0 { sum[i] / count[i] } else { 0.0 };
                        let d = this.difference(x, i, direction);
                        let broken = 1.0 + d * d / (crease * crease);
                        multiplicity / ((floor * floor * this.floor_part[i] + mean) * broken * broken)
                    } else {
                        0.0
                    };
                }
                sum
            })
            .collect();
        [self.wxx, self.wyy, self.wxy] = weights.try_into().expect("three directions");
    }

    /// Scales the variance of the floor at each pixel, by [`MAX_CHANGE`] at most; it never exceeds that of the whole floor.
    pub fn scale_floor(&mut self, scale: &[f32]) {
        for (part, scale) in self.floor_part.iter_mut().zip(scale) {
            *part = (*part * scale.clamp(1.0 / MAX_CHANGE, MAX_CHANGE)).clamp(LEAST_PART, 1.0);
        }
    }

    /// Returns the part of the floor's variance that counts at a pixel.
    pub(in crate::reconstruct::refine) fn floor_part(&self, i: usize) -> f32 {
        self.floor_part[i]
    }

    /// Returns whether the floor at a pixel is what the surface's roughness makes it, not one of its bounds.
    pub(in crate::reconstruct::refine) fn floor_follows(&self, i: usize) -> bool {
        (1.01 * LEAST_PART..0.99).contains(&self.floor_part[i])
    }

    /// Returns the linear system of the change of a surface whose data have information `h` and gradient `g` there.
    pub fn system<'a>(&'a self, h: &'a [f32], g: &'a [f32]) -> PlateSystem<'a> {
        let Self { width, height, active, wxx, wyy, wxy, .. } = self;
        PlateSystem { width: *width, height: *height, active, xx: wxx, yy: wyy, xy: wxy, h, g }
    }

    /// Returns Σ w (D x − a mean of theirs)² of the differences at each pixel. `mean` takes the differences of one
    /// direction and their weights, 0 where there is none.
    pub(in crate::reconstruct::refine) fn energy(
        &self,
        x: &[f32],
        mean: impl Fn(&[f32], &[f32]) -> Vec<f32>,
    ) -> Vec<f32> {
        let mut energy = vec![0.0f32; x.len()];
        for (direction, weights) in [&self.wxx, &self.wyy, &self.wxy].into_iter().enumerate() {
            let difference = |i: usize| if weights[i] > 0.0 { self.difference(x, i, direction) } else { 0.0 };
            let differences: Vec<f32> = (0..x.len()).into_par_iter().with_min_len(self.width).map(difference).collect();
            let mean = mean(&differences, weights);
            let squares = differences.iter().zip(&mean).zip(weights).map(|((d, mean), w)| w * (d - mean).powi(2));
            energy.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
        }
        energy
    }

    /// Returns the geometric mean of the weights of a pixel's own second differences along x and y: the weight of a
    /// uniform plate around it. 0 where there is none.
    pub(in crate::reconstruct::refine) fn weight(&self, i: usize) -> f32 {
        match (self.wxx[i], self.wyy[i]) {
            (a, b) if a > 0.0 && b > 0.0 => (a * b).sqrt(),
            (a, b) => a.max(b),
        }
    }
}
