//! Intrinsics and pose of a projector from points and their projector pixels.

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Matrix4, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3,
};
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::{Camera, Projector};

use super::options::Lens;
use super::sample::Sample;

/// A fitted projector.
pub(crate) struct Fitted {
    pub(super) projector: Projector,
    pub(super) rms_px: f64,
    /// Samples that contradict the others.
    pub(super) rejected: usize,
    pub(super) center_sigma_mm: [f64; 3],
}

/// Parameters: fx fy cx cy, k1 k2 p1 p2, rotation vector, translation.
const N: usize = 14;
type Parameters = SVector<f64, N>;

/// Residuals beyond this many robust standard deviations are outliers.
const REJECT_SIGMAS: f64 = 5.0;

/// Fits a projector whose image has this size; `None` if the samples do not determine one.
pub(crate) fn fit(samples: &[Sample], size: [usize; 2], lens: Lens) -> Option<Fitted> {
    let start = direct(samples)?;
    let free: Vec<usize> = match lens {
        Lens::None => (0..4).chain(8..N).collect(),
        Lens::Radial => (0..6).chain(8..N).collect(),
        Lens::Full => (0..N).collect(),
    };
    // The pinhole first: distortion from a poor start goes astray.
    let pinhole: Vec<usize> = (0..4).chain(8..N).collect();
    let mut used = vec![true; samples.len()];
    let mut p = refine(samples, &used, &pinhole, start)?;
    for _ in 0..4 {
        p = refine(samples, &used, &free, p)?;
        let norms: Vec<f64> = samples.iter().map(|s| residual(&p, s).map_or(f64::MAX, |r| r[0].hypot(r[1]))).collect();
        // The median of a Rayleigh variable is 1.1774 σ.
        let sigma = nelu3d_scan::statistics::percentile(&mut norms.clone(), 50.0) / 1.1774;
        used = norms.iter().map(|n| *n <= REJECT_SIGMAS * sigma.max(1e-6)).collect();
    }
    let p = refine(samples, &used, &free, p)?;
    let kept = used.iter().filter(|u| **u).count();
    let mut square = 0.0;
    for (s, _) in samples.iter().zip(&used).filter(|(_, u)| **u) {
        let r = residual(&p, s)?;
        square += r[0] * r[0] + r[1] * r[1];
    }
    let plausible = p[0] > 0.0 && p[1] > 0.0 && kept * 2 > samples.len();
    if !plausible || p.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let projector = projector(&p, size, lens);
    // Covariance of the parameters from the residuals, carried to the center by differences.
    let (normal, _) = normal_equations(samples, &used, &free, &p)?;
    let freedom = (2 * kept).saturating_sub(free.len()).max(1) as f64;
    let covariance = normal.try_inverse()? * (square / freedom);
    let center = |p: &Parameters| isometry(p).inverse() * nalgebra::Point3::origin();
    let here = center(&p);
    let jacobian = DMatrix::from_fn(3, free.len(), |row, k| {
        let mut q = p;
        let h = step(free[k]);
        q[free[k]] += h;
        (center(&q)[row] - here[row]) / h
    });
    let center_covariance = &jacobian * covariance * jacobian.transpose();
    Some(Fitted {
        projector,
        rms_px: (square / kept as f64).sqrt(),
        rejected: samples.len() - kept,
        center_sigma_mm: std::array::from_fn(|i| center_covariance[(i, i)].max(0.0).sqrt()),
    })
}

fn isometry(p: &Parameters) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(p[8], p[9], p[10]));
    Isometry3::from_parts(Translation3::new(p[11], p[12], p[13]), rotation)
}

fn projector(p: &Parameters, [width, height]: [usize; 2], lens: Lens) -> Projector {
    let coefficients = [p[4], p[5], p[6], p[7]];
    let n = if lens == Lens::None { 0 } else { 4 };
    let distortion = Distortion::new(&coefficients[..n]).expect("finite, and 0 or 4 of them");
    let optics = Camera { distortion, ..Camera::pinhole(width, height, p[0], p[1], p[2], p[3]) };
    Projector { optics, proj_from_cam: isometry(p) }
}

/// Computed minus seen projector pixel; `None` behind the projector.
fn residual(p: &Parameters, s: &Sample) -> Option<[f64; 2]> {
    let q = isometry(p) * s.point;
    if q.z <= 1e-9 {
        return None;
    }
    let (x, y) = (q.x / q.z, q.y / q.z);
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (p[4] + r2 * p[5]);
    let xd = x * radial + 2.0 * p[6] * x * y + p[7] * (r2 + 2.0 * x * x);
    let yd = y * radial + p[6] * (r2 + 2.0 * y * y) + 2.0 * p[7] * x * y;
    Some([p[0] * xd + p[2] - s.px[0], p[1] * yd + p[3] - s.px[1]])
}

/// Step of the difference quotient by a parameter.
fn step(parameter: usize) -> f64 {
    match parameter {
        0..=3 => 1e-3,
        4..=10 => 1e-6,
        _ => 1e-4,
    }
}

/// Matrix and right-hand side of the Gauss–Newton step over the free parameters.
fn normal_equations(
    samples: &[Sample],
    used: &[bool],
    free: &[usize],
    p: &Parameters,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let n = free.len();
    let mut a = DMatrix::zeros(n, n);
    let mut b = DVector::zeros(n);
    for (s, _) in samples.iter().zip(used).filter(|(_, u)| **u) {
        let r = residual(p, s)?;
        let mut rows = DMatrix::zeros(2, n);
        for (k, parameter) in free.iter().enumerate() {
            let mut q = *p;
            let h = step(*parameter);
            q[*parameter] += h;
            let moved = residual(&q, s)?;
            rows[(0, k)] = (moved[0] - r[0]) / h;
            rows[(1, k)] = (moved[1] - r[1]) / h;
        }
        a += rows.transpose() * &rows;
        b += rows.transpose() * DVector::from_row_slice(&r);
    }
    Some((a, b))
}

/// Levenberg–Marquardt over the free parameters.
fn refine(samples: &[Sample], used: &[bool], free: &[usize], start: Parameters) -> Option<Parameters> {
    let cost = |p: &Parameters| -> f64 {
        let each = samples.iter().zip(used).filter(|(_, u)| **u);
        each.map(|(s, _)| residual(p, s).map_or(f64::INFINITY, |r| r[0] * r[0] + r[1] * r[1])).sum()
    };
    let mut p = start;
    let mut best = cost(&p);
    if !best.is_finite() {
        return None;
    }
    let mut damping = 1e-4;
    for _ in 0..100 {
        let (a, b) = normal_equations(samples, used, free, &p)?;
        let mut improved = false;
        for _ in 0..12 {
            let mut damped = a.clone();
            for k in 0..free.len() {
                damped[(k, k)] *= 1.0 + damping;
            }
            let Some(change) = damped.lu().solve(&b) else {
                damping *= 10.0;
                continue;
            };
            let mut q = p;
            free.iter().zip(change.iter()).for_each(|(k, c)| q[*k] -= c);
            let now = cost(&q);
            if now < best {
                improved = best - now > 1e-10 * best;
                (p, best) = (q, now);
                damping = (damping * 0.2).max(1e-12);
                break;
            }
            damping *= 10.0;
        }
        if !improved {
            break;
        }
    }
    Some(p)
}

/// The direct linear transform from points to pixels (Hartley & Zisserman, algorithm 7.1), split into intrinsics and pose.
/// `None` for points on one plane.
fn direct(samples: &[Sample]) -> Option<Parameters> {
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

/// An upper triangular matrix with a positive diagonal times a rotation; `None` for a singular or mirrored matrix.
fn rq(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn truth() -> Projector {
        let distortion = Distortion::new(&[-0.03, 0.02, 4e-4, -3e-4]).unwrap();
        Projector {
            optics: Camera { distortion, ..Camera::pinhole(640, 400, 1250.0, 1247.0, 322.0, 203.0) },
            proj_from_cam: Isometry3::new(Vector3::new(-180.0, 20.0, 30.0), Vector3::new(0.02, 0.27, -0.01)),
        }
    }

    /// Corners of boards of one angle at several depths, as on a stage.
    fn samples(depths: &[f64]) -> Vec<Sample> {
        let truth = truth();
        let mut out = Vec::new();
        for z in depths {
            for i in 0..8 {
                for j in 0..6 {
                    let (x, y) = (25.0 * f64::from(i) - 90.0, 24.0 * f64::from(j) - 60.0);
                    let point = Point3::new(x, y, z + 0.05 * x);
                    out.push(Sample { point, px: truth.project(&point).unwrap() });
                }
            }
        }
        out
    }

    #[test]
    fn a_projector_comes_back_with_outliers_and_from_parallel_boards() {
        let mut seen = samples(&[630.0, 670.0, 710.0, 770.0]);
        for k in [3, 50, 120] {
            seen[k].px[0] += 7.0;
        }
        let fitted = fit(&seen, [640, 400], Lens::Full).unwrap();
        assert_eq!(fitted.rejected, 3);
        assert!(fitted.rms_px < 1e-4, "{}", fitted.rms_px);
        assert!((fitted.projector.center() - truth().center()).norm() < 0.01);
        for s in samples(&[600.0, 800.0]) {
            let px = fitted.projector.project(&s.point).unwrap();
            assert!((px[0] - s.px[0]).hypot(px[1] - s.px[1]) < 0.01);
        }
        // Without distortion it cannot be as good.
        assert!(fit(&seen, [640, 400], Lens::None).unwrap().rms_px > 0.01);
    }

    #[test]
    fn one_plane_does_not_determine_a_projector() {
        assert!(fit(&samples(&[700.0]), [640, 400], Lens::Full).is_none());
    }

    #[test]
    fn a_matrix_splits_into_triangle_and_rotation() {
        let k = Matrix3::new(1200.0, 3.0, 320.0, 0.0, 1100.0, 200.0, 0.0, 0.0, 1.0);
        let r = Rotation3::from_scaled_axis(Vector3::new(0.3, -0.8, 0.1)).into_inner();
        let (a, b) = rq(&(k * r)).unwrap();
        assert!((a - k).amax() < 1e-9 && (b - r).amax() < 1e-12);
        assert!(rq(&(-k * r)).is_none());
    }
}
