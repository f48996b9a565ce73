use nalgebra::{Matrix2, Matrix2x3, Point3};

use crate::Camera;

/// Returns the pixel of a camera-frame point, and its derivative by the point (px/mm); `None` behind the camera.
pub(crate) fn project_with_jacobian(camera: &Camera, p: &Point3<f64>) -> Option<([f64; 2], Matrix2x3<f64>)> {
    let px = camera.project(p)?;
    let (x, y) = (p.x / p.z, p.y / p.z);
    // The distortion is smooth and of order one: central differences are good to 1e-10, far below any corner's noise.
    let h = 1e-6;
    let d = |x, y| camera.distortion.distort([x, y]);
    let (a, b) = (d(x + h, y), d(x - h, y));
    let (c, e) = (d(x, y + h), d(x, y - h));
    let k = 0.5 / h;
    let by_plane = Matrix2::new(
        camera.fx * k * (a[0] - b[0]),
        camera.fx * k * (c[0] - e[0]),
        camera.fy * k * (a[1] - b[1]),
        camera.fy * k * (c[1] - e[1]),
    );
    let plane_by_point = Matrix2x3::new(1.0 / p.z, 0.0, -x / p.z, 0.0, 1.0 / p.z, -y / p.z);
    Some((px, by_plane * plane_by_point))
}
