//! The first guess of a projector: a direct linear transform.

use nalgebra::{Matrix3, Matrix4, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::sample::Sample;

/// Number of parameters of a projector.
pub(super) const N: usize = 14;

/// Parameters of a projector: fx fy cx cy, k1 k2 p1 p2, rotation vector, translation.
pub(super) type Parameters = SVector<f64, N>;

/// Solves the direct linear transform from points to pixels (Hartley & Zisserman, algorithm 7.1) and splits it into
/// intrinsics and pose.
/// `None` for points on one plane.
pub(super) fn direct(samples: &[Sample]) -> Option<Parameters> {
    let n = samples.len() as f64;
    let mean = samples.iter().fold(Vector3::zeros(), |m, s| m + s.point.coords / n);
    let spread = samples.iter().map(|s| (s.point.coords - mean).norm()).sum::<f64>() / n;
    let center = samples.iter().fold([0.0; 2], |m, s| [m[0] + s.px[0] / n, m[1] + s.px[1] / n]);
    let spread_px = samples.iter().map(|s| (s.px[0] - center[0]).hypot(s.px[1] - center[1])).sum::<f64>() / n;
    if !(spread > 1e-6 && spread_px > 1e-6) {
        return None;
    }
    let mut normal = SMatrix::<f64, 12, 12>::zeros();
    for s in samples {
        let q = (s.point.coords - mean) / spread;
        let (u, v) = ((s.px[0] - center[0]) / spread_px, (s.px[1] - center[1]) / spread_px);
        let h = [q.x, q.y, q.z, 1.0];
        let (mut a, mut b) = (SVector::<f64, 12>::zeros(), SVector::<f64, 12>::zeros());
        for k in 0..4 {
            (a[k], a[8 + k]) = (h[k], -u * h[k]);
            (b[4 + k], b[8 + k]) = (h[k], -v * h[k]);
        }
        normal += a * a.transpose() + b * b.transpose();
    }
    let eigen = normal.symmetric_eigen();
    let mut order: Vec<usize> = (0..12).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    // Points on one plane leave several solutions.
    if eigen.eigenvalues[order[1]] < 1e-9 * eigen.eigenvalues[order[11]] {
        return None;
    }
    let m = eigen.eigenvectors.column(order[0]);
    let normalized = SMatrix::<f64, 3, 4>::from_fn(|r, c| m[4 * r + c]);
    let to_px = Matrix3::new(spread_px, 0.0, center[0], 0.0, spread_px, center[1], 0.0, 0.0, 1.0);
    let s = 1.0 / spread;
    let from_mm =
        Matrix4::new(s, 0.0, 0.0, -mean.x * s, 0.0, s, 0.0, -mean.y * s, 0.0, 0.0, s, -mean.z * s, 0.0, 0.0, 0.0, 1.0);
    let p = to_px * normalized * from_mm;
    // In front of the projector.
    let depth: f64 = samples.iter().map(|s| (p * s.point.to_homogeneous()).z.signum()).sum();
    let p = p * depth.signum();
    let left = p.fixed_columns::<3>(0).into_owned();
    let (k, r) = rq(&left)?;
    let scale = k[(2, 2)];
    let t = k.try_inverse()? * p.column(3);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r)).scaled_axis();
    let k = k / scale;
    let out = [
        k[(0, 0)],
        k[(1, 1)],
        k[(0, 2)],
        k[(1, 2)],
        0.0,
        0.0,
        0.0,
        0.0,
        rotation.x,
        rotation.y,
        rotation.z,
        t.x,
        t.y,
        t.z,
    ];
    out.iter().all(|v| v.is_finite()).then(|| Parameters::from(out))
}

/// Splits a matrix into an upper triangular matrix with a positive diagonal times a rotation (RQ decomposition); `None`
/// for a singular or mirrored matrix.
pub fn rq(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    // The QR decomposition of the matrix turned by 180 degrees.
    let flip = Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0);
    let qr = (flip * m).transpose().qr();
    let (mut k, mut r) = (flip * qr.r().transpose() * flip, flip * qr.q().transpose());
    for i in 0..3 {
        if k[(i, i)] < 0.0 {
            for j in 0..3 {
                k[(j, i)] = -k[(j, i)];
                r[(i, j)] = -r[(i, j)];
            }
        }
    }
    (k[(2, 2)] > 1e-12 && r.determinant() > 0.5).then_some((k, r))
}
