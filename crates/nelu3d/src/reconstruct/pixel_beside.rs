//! Neighbors of a pixel in its row or column.

use nelu3d_scan::Camera;

/// Returns the index of the pixel `by` pixels from pixel `i` in a direction (columns, rows), if it is in the image.
pub(super) fn pixel_beside(i: usize, [dx, dy]: [isize; 2], by: isize, camera: &Camera) -> Option<usize> {
    let x = (i % camera.width).checked_add_signed(by * dx).filter(|x| *x < camera.width)?;
    let y = (i / camera.width).checked_add_signed(by * dy).filter(|y| *y < camera.height)?;
    Some(y * camera.width + x)
}
