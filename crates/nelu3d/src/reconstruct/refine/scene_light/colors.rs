//! Crosstalk of a color camera that the measurements have not been cleared of (`sensor/crosstalk.rs`).

use nalgebra::Vector3;

use crate::sensor::{CrosstalkCorrection, CrosstalkMatrix, Measurements, relative_white};

/// Range of an off-diagonal entry. Below zero: what was taken out before was too much.
const LIMITS: [f64; 2] = [-0.1, 0.4];
/// Range of the ratio of two colors that a surface returns.
const RATIOS: [f32; 2] = [0.1, 10.0];

/// The matrix and what it acts on.
pub(super) struct Colors {
    /// White − black of the board, per channel.
    board: [f32; 3],
    /// The six off-diagonal entries that are applied, row by row.
    applied: [f64; 6],
    /// Their matrix; `None` where all are 0.
    correction: Option<CrosstalkCorrection>,
}

impl Colors {
    /// No crosstalk, beside a board of this white − black.
    pub(super) fn new(board: [f32; 3]) -> Self {
        Self { board, applied: [0.0; 6], correction: None }
    }

    /// Returns the six off-diagonal entries that are applied, row by row.
    pub(super) fn applied(&self) -> [f64; 6] {
        self.applied
    }

    /// Sets them, within their range.
    pub(super) fn apply(&mut self, entries: [f64; 6]) {
        self.applied = entries.map(|v| v.clamp(LIMITS[0], LIMITS[1]));
        let all_zero = self.applied.iter().all(|v| *v == 0.0);
        self.correction = if all_zero { None } else { CrosstalkCorrection::new(&self.matrix()) };
    }

    /// Returns the matrix that is applied.
    pub(super) fn matrix(&self) -> CrosstalkMatrix {
        CrosstalkMatrix::from_free(&self.applied)
    }

    /// Returns whether any is applied.
    pub(super) fn is_applied(&self) -> bool {
        self.correction.is_some()
    }

    /// Changes the field's codewords and their slopes at pixel `px` of the image, `2 k` values, to what the object shows.
    pub(super) fn change(&self, m: &Measurements, px: usize, rendered: &mut [f32]) {
        let Some(correction) = &self.correction else { return };
        let change = correction.object_from_board(relative_white(m, px, &self.board));
        for of_image in rendered.chunks_exact_mut(3) {
            let c = change * Vector3::from_column_slice(of_image);
            of_image.copy_from_slice(c.as_slice());
        }
    }

    /// Returns, for each of the six entries, the channel that it changes, the channel whose light that one sees, and
    /// the change per entry and difference of their codewords: (ρ_m/ρ_i − 1) of (c_m − c_i), where ρ is what the surface
    /// returns of a color.
    pub(super) fn per_entry(&self, m: &Measurements, px: usize) -> [(usize, usize, f32); 6] {
        let white = relative_white(m, px, &self.board);
        let ratio = |i: usize, j: usize| (white[j] / white[i].max(1e-6)).clamp(RATIOS[0], RATIOS[1]) - 1.0;
        [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)].map(|(i, j)| (i, j, ratio(i, j)))
    }
}
