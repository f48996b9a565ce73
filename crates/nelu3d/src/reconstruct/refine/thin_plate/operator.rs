//! The matrix of the linear system, diag(h) + DᵀWD, applied without being formed.

use super::prior::ThinPlatePrior;
use super::row_sums::dot;

/// Rows that one task of the solver works on. Sums are taken block by block, in order: they do not depend on the
/// threads.
pub(super) const BLOCK: usize = 16;

/// Weighted differences of a block's rows and of the rows above and below: along x, along y, mixed.
pub(super) type Scratch = [Vec<f32>; 3];

impl ThinPlatePrior {
    /// Allocates the scratch memory of one block.
    pub(super) fn scratch(&self) -> Scratch {
        [(); 3].map(|()| vec![0.0; (BLOCK + 2) * self.width])
    }

    /// Computes y = (diag(h) + DᵀWD) x for the rows of one block; returns Σ x y.
    pub(super) fn apply_block(&self, block: usize, h: &[f32], x: &[f32], scratch: &mut Scratch, y: &mut [f32]) -> f64 {
        let w = self.width;
        let first = block * BLOCK;
        let rows = y.len() / w;
        // Inner pixels of a row: all slices below have this length, so that loops over them need no checks.
        let n = w - 2;
        // Scratch row r is image row first + r − 1.
        for r in 0..rows + 2 {
            let [xx, yy, xy] = scratch.each_mut().map(|s| &mut s[r * w..(r + 1) * w]);
            let Some(row) = (first + r).checked_sub(1).filter(|row| *row > 0 && row + 1 < self.height) else {
                [xx, yy, xy].into_iter().for_each(|s| s.fill(0.0));
                continue;
            };
            let at = row * w;
            let (west, here, east) = (&x[at..][..n], &x[at + 1..][..n], &x[at + 2..][..n]);
            let (north, south, south_east) = (&x[at + 1 - w..][..n], &x[at + 1 + w..][..n], &x[at + 2 + w..][..n]);
            let (wxx, wyy, wxy) = (&self.wxx[at + 1..][..n], &self.wyy[at + 1..][..n], &self.wxy[at + 1..][..n]);
            let (xx, yy, xy) = (&mut xx[1..][..n], &mut yy[1..][..n], &mut xy[1..][..n]);
            for i in 0..n {
                let c = here[i];
                xx[i] = wxx[i] * (west[i] - 2.0 * c + east[i]);
                yy[i] = wyy[i] * (north[i] - 2.0 * c + south[i]);
                xy[i] = wxy[i] * (c - east[i] - south[i] + south_east[i]);
            }
        }
        let [xx, yy, xy] = &*scratch;
        let mut sum = 0.0;
        for (r, y) in y.chunks_exact_mut(w).enumerate() {
            let at = (first + r) * w + 1;
            let (h, x) = (&h[at..][..n], &x[at..][..n]);
            // Where the row above, this row and the row below begin in scratch.
            let [above, here, below] = [r, r + 1, r + 2].map(|r| r * w + 1);
            let (west, middle, east) = (&xx[here - 1..][..n], &xx[here..][..n], &xx[here + 1..][..n]);
            let (north, center, south) = (&yy[above..][..n], &yy[here..][..n], &yy[below..][..n]);
            let (own, left) = (&xy[here..][..n], &xy[here - 1..][..n]);
            let (up, up_left) = (&xy[above..][..n], &xy[above - 1..][..n]);
            let y = &mut y[1..][..n];
            for i in 0..n {
                let straight = west[i] - 2.0 * middle[i] + east[i] + north[i] - 2.0 * center[i] + south[i];
                let mixed = own[i] - left[i] - up[i] + up_left[i];
                y[i] = h[i] * x[i] + straight + mixed;
            }
            sum += dot(x, y);
        }
        sum
    }

    /// Returns one over the diagonal of diag(h) + DᵀWD; 0 where there is no surface.
    pub(super) fn inverse_diagonal(&self, h: &[f32]) -> Vec<f32> {
        let w = self.width;
        let mut diag = h.to_vec();
        for i in 0..diag.len() {
            let (a, c, e) = (self.wxx[i], self.wyy[i], self.wxy[i]);
            if a > 0.0 {
                diag[i - 1] += a;
                diag[i] += 4.0 * a;
                diag[i + 1] += a;
            }
            if c > 0.0 {
                diag[i - w] += c;
                diag[i] += 4.0 * c;
                diag[i + w] += c;
            }
            if e > 0.0 {
                for j in [i, i + 1, i + w, i + w + 1] {
                    diag[j] += e;
                }
            }
        }
        diag.iter().zip(&self.active).map(|(d, on)| if *on && *d > 0.0 { 1.0 / d } else { 0.0 }).collect()
    }
}
