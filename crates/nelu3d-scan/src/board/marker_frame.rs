//! Boards of markers around an empty middle, where light falls on bare paper.

use super::{BoardError, BoardKind, Marker};

impl BoardKind {
    /// Returns markers along the edges of a rectangle of `size_mm`, whose top left corner is the origin: upright squares
    /// of `marker_mm`, as many as leave `gap_mm` or more between them, numbered clockwise from `first` at the top left.
    ///
    /// # Errors
    ///
    /// No two markers fit along a side.
    pub fn marker_frame(
        size_mm: [f64; 2],
        marker_mm: f64,
        gap_mm: f64,
        dictionary: &str,
        first: u32,
    ) -> Result<Self, BoardError> {
        let positive = marker_mm > 0.0 && gap_mm > 0.0 && size_mm.iter().all(|s| s.is_finite());
        if !(positive && size_mm.iter().all(|s| *s >= 2.0 * marker_mm + gap_mm)) {
            let [w, h] = size_mm;
            return Err(BoardError::invalid(format!(
                "a frame of {w} x {h} mm holds no two markers of {marker_mm} mm, {gap_mm} mm apart, along each side"
            )));
        }
        // Rounding must not lose a marker that just fits.
        let [nx, ny] = size_mm.map(|s| ((s + gap_mm) / (marker_mm + gap_mm) + 1e-9).floor().min(1000.0) as usize);
        let at = |k: usize, i: usize, n: usize| i as f64 * (size_mm[k] - marker_mm) / (n - 1) as f64;
        let (right, low) = (size_mm[0] - marker_mm, size_mm[1] - marker_mm);
        let top = (0..nx).map(|i| [at(0, i, nx), 0.0]);
        let down = (1..ny).map(|i| [right, at(1, i, ny)]);
        let back = (0..nx - 1).rev().map(|i| [at(0, i, nx), low]);
        let up = (1..ny - 1).rev().map(|i| [0.0, at(1, i, ny)]);
        let marker = |(i, [x, y]): (usize, [f64; 2])| Marker {
            id: first + i as u32,
            corners_mm: [[x, y], [x + marker_mm, y], [x + marker_mm, y + marker_mm], [x, y + marker_mm]],
        };
        let markers = top.chain(down).chain(back).chain(up).enumerate().map(marker).collect();
        Ok(BoardKind::Markers { dictionary: dictionary.to_owned(), markers })
    }
}
