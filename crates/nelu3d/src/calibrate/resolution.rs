//! How many cells a field has.

use nalgebra::Point3;
use nelu3d_scan::Camera;

use super::binning::{MAX_COEFFS, MAX_COEFFS_OF_BLOCKS};
use super::placed_sweep::PlacedSweep;
use crate::color_field::frame::{Center, FieldFrame};

/// Most cells along w in the light's frame, where only defocus changes.
const MAX_CELLS_ALONG_LIGHT: usize = 4;

/// Cells along a, b and w: across, `cells_per_pixel` per pixel where the volume is; along, what the sweep can
/// supervise.
///
/// The cells across hold the edges of the code, and come first: in the light's frame there are only as many cells along
/// as leave room for them. One is a cubic along every ray of light.
pub(super) fn resolution(
    placed: &PlacedSweep<'_>,
    frame: &FieldFrame,
    center: Center,
    cells_per_pixel: usize,
) -> [usize; 3] {
    let n_positions = placed.n_positions();
    let [pitch_a, pitch_b] = pitch(&placed.camera, placed.mean_point().into(), frame);
    let span = |i: usize| frame.hi[i] - frame.lo[i];
    let across =
        [(span(0) / pitch_a).ceil() as usize, (span(1) / pitch_b).ceil() as usize].map(|n| n * cells_per_pixel);
    let most_coeffs = if placed.sweep.binning > 1 { MAX_COEFFS_OF_BLOCKS } else { MAX_COEFFS };
    let nodes = |along: usize| (across[0] + 3) * (across[1] + 3) * (along + 3) * placed.sweep.k;
    let along = match center {
        Center::Light => {
            let most = (n_positions / 4).clamp(1, MAX_CELLS_ALONG_LIGHT);
            (1..=most).rev().find(|along| nodes(*along) <= most_coeffs).unwrap_or(1)
        }
        Center::Camera => n_positions - 1,
    };
    let shrink = (most_coeffs as f64 / nodes(along) as f64).sqrt().min(1.0);
    let [a, b] = across.map(|n| ((n as f64 * shrink) as usize).max(4));
    [a, b, along]
}

/// Cells of the spline that form `published` becomes: finer along w than what the sweep supervises, as far as there is
/// room, so that the spline has the values that the network has between the boards.
pub(super) fn spline_cells([a, b, along]: [usize; 3], k: usize) -> [usize; 3] {
    let fits = |times: &usize| (a + 3) * (b + 3) * (along * times + 3) * k <= MAX_COEFFS;
    [a, b, along * (1..=4).rev().find(fits).unwrap_or(1)]
}

/// Distance between neighboring pixels' samples at the middle of the volume along a and b, mm of the frame.
pub(super) fn pitch(camera: &Camera, mid: Point3<f64>, frame: &FieldFrame) -> [f64; 2] {
    let px = camera.project(&mid).unwrap_or([camera.cx, camera.cy]);
    let at = |dx: f64, dy: f64| {
        let dir = camera.ray([px[0] + dx, px[1] + dy]).dir;
        frame.to_abw(&Point3::from(dir * (mid.z / dir.z))).unwrap_or([0.0; 3])
    };
    let (o, r, d) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0));
    [0, 1].map(|i| (r[i] - o[i]).hypot(d[i] - o[i]).max(1e-9))
}

/// Whether the cells across are fewer than the pixels that see them.
pub(super) fn is_limited(placed: &PlacedSweep<'_>, frame: &FieldFrame, cells: [usize; 3]) -> bool {
    let pitch = pitch(&placed.camera, placed.mean_point().into(), frame);
    (0..2).any(|i| (cells[i] as f64) < 0.9 * (frame.hi[i] - frame.lo[i]) / pitch[i])
}
