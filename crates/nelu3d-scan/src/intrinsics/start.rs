//! Where the fit starts: Zhang's closed form, for a camera with square pixels whose axis meets the middle of the picture.

use nalgebra::Vector3;

use super::view::View;
use crate::Camera;
use crate::pose::Homography;

/// Returns cameras to start from: with the focal length of Zhang's constraints (2000, §3.1, equations 3 and 4), where
/// the views have one, and with a few usual ones.
pub(super) fn cameras(views: &[&View], [width, height]: [usize; 2]) -> Vec<Camera> {
    let (w, h) = (width as f64, height as f64);
    let (cx, cy) = (0.5 * (w - 1.0), 0.5 * (h - 1.0));
    let side = w.max(h);
    let mut focals: Vec<f64> = focal(views, [cx, cy], side).into_iter().collect();
    // From fisheyes to long lenses.
    focals.extend([0.6, 1.0, 1.8, 3.5].map(|f| f * side));
    focals.into_iter().map(|f| Camera::pinhole(width, height, f, f, cx, cy)).collect()
}

/// Returns the focal length, px, at which the axes of all boards are as perpendicular and as long as each other; `None`
/// where they leave it open.
fn focal(views: &[&View], [cx, cy]: [f64; 2], side: f64) -> Option<f64> {
    let (mut above, mut below) = (0.0, 0.0);
    for view in views {
        let board: Vec<[f64; 2]> = view.corners.iter().map(|c| c.board_mm).collect();
        let px: Vec<[f64; 2]> = view.corners.iter().map(|c| [(c.px[0] - cx) / side, (c.px[1] - cy) / side]).collect();
        let Some(h) = Homography::robust(&board, &px) else { continue };
        let (a, b): (Vector3<f64>, Vector3<f64>) = (h.matrix.column(0).into(), h.matrix.column(1).into());
        let scale = 2.0 / (a.norm_squared() + b.norm_squared());
        // w (aₓbₓ + a_y b_y) + a_z b_z = 0, and the same of a + b and a − b, for w = 1/f².
        for (p, q) in [(a, b), (a + b, a - b)] {
            let (in_plane, along) = (scale * (p.x * q.x + p.y * q.y), scale * p.z * q.z);
            above -= in_plane * along;
            below += in_plane * in_plane;
        }
    }
    let w = above / below;
    let f = side / w.sqrt();
    (f.is_finite() && (0.1 * side..50.0 * side).contains(&f)).then_some(f)
}
