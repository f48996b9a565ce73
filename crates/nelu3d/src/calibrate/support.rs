//! Where a field without a position is supported by the others.

use crate::color_field::frame::Center;
use crate::color_field::validity::Validity;

/// How many positions lit each ray of the frame, and from where to where along it. The error of a field at a position
/// that it was not made from counts only where the others support it: beyond, it could not be better.
pub(super) struct Support {
    center: Center,
    cells: [usize; 2],
    /// Positions per column of cells.
    count: Vec<u16>,
    /// Per column, first and last w that was lit.
    reach: Vec<[f32; 2]>,
}

impl Support {
    /// No position yet; columns are those of `validity`.
    pub(super) fn new(center: Center, validity: &Validity) -> Self {
        let cells = [validity.shape.cells[0], validity.shape.cells[1]];
        let n = cells[0] * cells[1];
        Self { center, cells, count: vec![0; n], reach: vec![[f32::INFINITY, f32::NEG_INFINITY]; n] }
    }

    /// Adds what one position lit.
    pub(super) fn add(&mut self, position: &Validity) {
        let n = position.shape.cells[2];
        for ((column, count), reach) in position.lit.chunks_exact(n).zip(&mut self.count).zip(&mut self.reach) {
            let Some(first) = column.iter().position(|l| *l == 1) else { continue };
            let last = column.iter().rposition(|l| *l == 1).unwrap_or(first);
            *count += 1;
            let at = |w: usize| (w as f32 + 0.5) / n as f32;
            *reach = [reach[0].min(at(first)), reach[1].max(at(last))];
        }
    }

    /// Returns how many positions support the ray of light at unit coordinates `q` and around it, 0 where these are
    /// fewer than `least`; in the camera's frame, where nothing is known along a ray but what positions saw, `q` has to
    /// lie between them.
    pub(super) fn at(&self, q: [f32; 3], least: u16) -> u16 {
        let [na, nb] = self.cells;
        let (a, b) = ((q[0] * na as f32) as isize, (q[1] * nb as f32) as isize);
        let around = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().map(|(da, db)| {
            let (a, b) = (a + da, b + db);
            if !(0..na as isize).contains(&a) || !(0..nb as isize).contains(&b) {
                return 0;
            }
            let i = b as usize * na + a as usize;
            let holds = self.center == Center::Light || (q[2] > self.reach[i][0] && q[2] < self.reach[i][1]);
            if holds { self.count[i] } else { 0 }
        });
        around.min().filter(|n| *n >= least).unwrap_or(0)
    }
}
