//! The color field that a calibrated projector throws.

use nelu3d_scan::{Image, Projector};
use rayon::prelude::*;

use super::response::{Projected, Response};
use crate::color_field::frame::FieldFrame;
use crate::color_field::grid::Grid;

/// Cells per projector pixel along an axis that a pattern changes along: edges lie anywhere between nodes, and with one
/// per pixel stripes of a Gray code are off by tenths of what they rise.
const CELLS_PER_PX: f64 = 2.0;
/// Cells per projector pixel along an axis that no pattern changes along; not one cell in all, as the projector's
/// columns lean a little against the frame.
const CELLS_PER_PX_OF_STRIPES: f64 = 0.25;
/// Fewest and most cells of the field across.
const CELLS: [f64; 2] = [8.0, 2048.0];
/// Most coefficients of the field, 320 MB.
const MAX_COEFFICIENTS: f64 = (80 << 20) as f64;

/// Renders the field: blurred patterns through the response, sampled at the nodes of a grid. Returns it with its cells
/// per projector pixel along an axis that a pattern changes along: the pixel is the unit of disparities.
pub(super) fn render_field(
    patterns: &[Image],
    projector: &Projector,
    frame: &FieldFrame,
    response: Response,
) -> (Grid, usize) {
    let blurred = |p: &Image| Projected::new(p, response.gamma).blurred(response.blur_px);
    let blurred: Vec<Projected> = patterns.iter().map(blurred).collect();
    let ([across, down], cells_per_pixel) = cells(patterns, projector, frame);
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
                let v = at.map_or(0.0, |at| image.at(at));
                for w in 0..nw {
                    row[(a * nw + w) * k + j] = response.offset + response.scale * v;
                }
            }
        }
    });
    grid.interpolate(&values);
    (grid, cells_per_pixel)
}

/// Returns the cells of the field across the light, along a and b, and how many a pixel has that is as large as it is
/// at the frame's middle, along an axis that a pattern changes along.
fn cells(patterns: &[Image], projector: &Projector, frame: &FieldFrame) -> ([usize; 2], usize) {
    let px = |q: [f64; 3]| projector.project(&frame.from_unit(q)).unwrap_or([0.0; 2]);
    let length = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let lengths = [length(px([0.0, 0.5, 0.5]), px([1.0, 0.5, 0.5])), length(px([0.5, 0.0, 0.5]), px([0.5, 1.0, 0.5]))];
    // A pattern that changes along one axis alone is a single row or column.
    let changes = [patterns.iter().any(|p| p.width > 1), patterns.iter().any(|p| p.height > 1)];
    let per_px = changes.map(|changes| if changes { CELLS_PER_PX } else { CELLS_PER_PX_OF_STRIPES });
    let wanted = [0, 1].map(|i| (per_px[i] * lengths[i]).clamp(CELLS[0], CELLS[1]));
    // One cell along w has four nodes.
    let coefficients = wanted[0] * wanted[1] * (4 * patterns.len()) as f64;
    let part = (MAX_COEFFICIENTS / coefficients).min(1.0).sqrt();
    let cells = wanted.map(|n| (part * n).ceil().max(CELLS[0]) as usize);
    let per_pixel = (0..2).filter(|i| changes[*i]).map(|i| (cells[i] as f64 / lengths[i]).round() as usize).max();
    (cells, per_pixel.unwrap_or(1).max(1))
}
