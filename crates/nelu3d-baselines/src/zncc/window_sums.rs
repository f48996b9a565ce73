//! Correlations summed over windows.

use super::codewords::{CodewordTable, SeenCodewords, centered, largest};
use crate::triangulate::Along;

/// The correlations of all depth hypotheses, summed over windows, of one row; rows go in at the bottom and out at the
/// top.
pub(super) struct WindowSums<'a> {
    seen: &'a SeenCodewords,
    table: &'a CodewordTable,
    along: &'a [Option<Along>],
    width: usize,
    hypotheses: usize,
    radius: usize,
    /// `width × hypotheses`: over the window's rows and columns.
    sum: Vec<f32>,
    /// Norms, summed over the window.
    norm: Vec<f32>,
    /// One row before and after the sum over its columns.
    row: Vec<f32>,
    scratch: (Vec<f32>, Vec<f32>),
}

impl<'a> WindowSums<'a> {
    pub(super) fn new(
        seen: &'a SeenCodewords,
        table: &'a CodewordTable,
        along: &'a [Option<Along>],
        width: usize,
        hypotheses: usize,
        radius: usize,
    ) -> Self {
        Self {
            seen,
            table,
            along,
            width,
            hypotheses,
            radius,
            sum: vec![0.0; width * hypotheses],
            norm: vec![0.0; width],
            row: vec![0.0; width * hypotheses],
            scratch: (vec![0.0; seen.k], Vec::new()),
        }
    }

    pub(super) fn add(&mut self, y: usize) {
        self.apply(y, 1.0);
    }

    /// Computed again instead of kept: a row of correlations is larger than the cache, and quickly made.
    pub(super) fn remove(&mut self, y: usize) {
        self.apply(y, -1.0);
    }

    pub(super) fn apply(&mut self, y: usize, sign: f32) {
        let (w, l) = (self.width, self.hypotheses);
        // Only the columns of the row's lit pixels, and a window's reach around them, have anything to sum.
        let lit = |x: &usize| self.along[y * w + x].is_some();
        let (Some(first), Some(last)) = ((0..w).find(lit), (0..w).rev().find(lit)) else { return };
        let (first, last) = (first.saturating_sub(self.radius), (last + self.radius).min(w - 1));
        let mut norms = vec![0.0; w];
        let (code, scores) = &mut self.scratch;
        for x in first..=last {
            let i = y * w + x;
            let out = &mut self.row[x * l..(x + 1) * l];
            out.fill(0.0);
            let Some(a) = &self.along[i] else { continue };
            norms[x] = centered(self.seen.at(i), code);
            let last = self.table.n - 1;
            let (low, high) = (a.a.min(a.b).max(0.0), a.a.max(a.b).min(last as f32));
            if low > high {
                continue;
            }
            let (low, high) = (low as usize, (high.ceil() as usize).min(last));
            self.table.correlate(code, low, high, scores);
            for (s, o) in out.iter_mut().enumerate() {
                let u = a.at(s as f32 / (l - 1) as f32) - low as f32;
                if u >= 0.0 && u <= (high - low) as f32 {
                    let k = (u as usize).min((high - low).saturating_sub(1));
                    let next = scores[(k + 1).min(high - low)];
                    *o = scores[k] + (u - k as f32) * (next - scores[k]);
                }
            }
        }
        // The sum over the window's columns, all hypotheses of a pixel at once.
        let mut running = vec![0.0f32; l];
        let mut running_norm = 0.0;
        for x in first..=last + self.radius {
            if x <= last {
                running.iter_mut().zip(&self.row[x * l..(x + 1) * l]).for_each(|(r, v)| *r += v);
                running_norm += norms[x];
            }
            if let Some(old) = x.checked_sub(2 * self.radius + 1).filter(|old| *old >= first) {
                running.iter_mut().zip(&self.row[old * l..(old + 1) * l]).for_each(|(r, v)| *r -= v);
                running_norm -= norms[old];
            }
            if let Some(center) = x.checked_sub(self.radius).filter(|c| (first..=last).contains(c)) {
                let out = &mut self.sum[center * l..(center + 1) * l];
                out.iter_mut().zip(&running).for_each(|(o, r)| *o += sign * r);
                self.norm[center] += sign * running_norm;
            }
        }
    }

    /// The best inverse depth of pixel x's window, as s in 0 to 1, and its correlation.
    pub(super) fn best(&self, x: usize) -> (f32, f32) {
        let l = self.hypotheses;
        let scores = &self.sum[x * l..(x + 1) * l];
        let (at, best) = largest(scores);
        // A parabola through the best and its neighbors.
        let mut s = at as f32;
        if at > 0 && at + 1 < l {
            let (a, b) = (scores[at - 1], scores[at + 1]);
            let curvature = a - 2.0 * best + b;
            if curvature < 0.0 {
                s += (0.5 * (a - b) / curvature).clamp(-0.5, 0.5);
            }
        }
        (s / (l - 1) as f32, if self.norm[x] > 1e-4 { best / self.norm[x] } else { f32::NAN })
    }
}
