//! The color field that a calibrated projector throws.

use nelu3d_scan::{Image, Projector};
use rayon::prelude::*;

use super::response::{Response, projected, value_at};
use crate::color_field::frame::FieldFrame;
use crate::color_field::grid::Grid;

/// Fewest and most cells of the field across.
const CELLS: [f64; 2] = [8.0, 2048.0];

/// Renders the field: blurred patterns through the response, sampled at the nodes of a grid whose cells are as large as
/// the projector's pixels.
pub(super) fn render_field(patterns: &[Image], projector: &Projector, frame: &FieldFrame, response: Response) -> Grid {
    let blurred: Vec<Image> = patterns.iter().map(|p| projected(p, response.blur_px, response.gamma)).collect();
    // Projector pixels across the frame at its middle.
    let px = |q: [f64; 3]| projector.project(&frame.from_unit(q)).unwrap_or([0.0; 2]);
    let length = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let cells = |from: [f64; 3], to: [f64; 3]| length(px(from), px(to)).ceil().clamp(CELLS[0], CELLS[1]) as usize;
    let across = cells([0.0, 0.5, 0.5], [1.0, 0.5, 0.5]);
    let down = cells([0.5, 0.0, 0.5], [0.5, 1.0, 0.5]);
    let k = patterns.len();
    // Nothing changes along the projector's rays: one cell.
    let mut grid = Grid::new([across, down, 1], k);
    let [na, nb, nw] = grid.nodes();
    let mut values = vec![0.0f32; na * nb * nw * k];
    values.par_chunks_mut(na * nw * k).enumerate().for_each(|(b, row)| {
        for a in 0..na {
            let q = [(a as f64 - 1.0) / across as f64, (b as f64 - 1.0) / down as f64, 0.5];
            let at = projector.project(&frame.from_unit(q));
            for (j, image) in blurred.iter().enumerate() {
                let v = at.map_or(0.0, |at| value_at(image, at));
                for w in 0..nw {
                    row[(a * nw + w) * k + j] = response.offset + response.scale * v;
                }
            }
        }
    });
    grid.interpolate(&values);
    grid
}
