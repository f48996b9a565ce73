//! Intrinsics and pose of a projector from points and their projector pixels.

use nalgebra::{DMatrix, DVector, Isometry3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::least_squares::{LmSettings, Problem, minimize};
use nelu3d_scan::statistics::percentile;
use nelu3d_scan::{Camera, Projector};

use super::direct::{N, Parameters, direct};
use super::options::Lens;
use super::sample::Sample;

/// A fitted projector.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Optics and pose.
    pub projector: Projector,
    /// Root mean square distance between a used sample's computed and seen projector pixel, px.
    pub rms_px: f64,
    /// Number of samples that contradict the others, and are not used.
    pub rejected: usize,
    /// Standard deviation of the projector's center, from the residuals alone, mm.
    pub center_sigma_mm: [f64; 3],
}

/// Residuals beyond this many robust standard deviations are outliers.
const REJECT_SIGMAS: f64 = 5.0;

/// Fits a projector whose image has `size` (width, height; px); `None` if the samples do not determine one. Samples on
/// one plane never do.
pub fn fit(samples: &[Sample], size: [usize; 2], lens: Lens) -> Option<Fitted> {
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
        let sigma = percentile(&mut norms.clone(), 50.0) / 1.1774;
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

/// Returns the computed minus the seen projector pixel; `None` behind the projector.
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

/// Returns the step of the difference quotient by a parameter.
fn step(parameter: usize) -> f64 {
    match parameter {
        0..=3 => 1e-3,
        4..=10 => 1e-6,
        _ => 1e-4,
    }
}

/// Builds matrix and right-hand side of the Gauss–Newton step over the free parameters.
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

/// The projector's reprojection error as a problem of least squares over the free parameters.
struct Reprojection<'a> {
    samples: &'a [Sample],
    used: &'a [bool],
    free: &'a [usize],
    matrix: DMatrix<f64>,
    rhs: DVector<f64>,
}

impl Problem for Reprojection<'_> {
    type Parameters = Parameters;

    fn cost(&mut self, p: &Parameters) -> f64 {
        let each = self.samples.iter().zip(self.used).filter(|(_, u)| **u);
        each.map(|(s, _)| residual(p, s).map_or(f64::INFINITY, |r| r[0] * r[0] + r[1] * r[1])).sum()
    }

    fn linearize(&mut self, p: &Parameters, cost: f64) -> Option<f64> {
        (self.matrix, self.rhs) = normal_equations(self.samples, self.used, self.free, p)?;
        Some(cost)
    }

    fn step(&mut self, p: &Parameters, damping: f64) -> Option<Parameters> {
        let mut damped = self.matrix.clone();
        for k in 0..self.free.len() {
            damped[(k, k)] *= 1.0 + damping;
        }
        let change = damped.lu().solve(&self.rhs)?;
        let mut q = *p;
        self.free.iter().zip(change.iter()).for_each(|(k, c)| q[*k] -= c);
        Some(q)
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-10 * before
    }
}

/// Refines the free parameters by Levenberg–Marquardt; `None` if the start puts a sample behind the projector.
fn refine(samples: &[Sample], used: &[bool], free: &[usize], start: Parameters) -> Option<Parameters> {
    let settings = LmSettings {
        damping: 1e-4,
        min_damping: 1e-12,
        max_damping: f64::INFINITY,
        lower: 0.2,
        raise: 10.0,
        max_iterations: 100,
        max_trials: 12,
        ..LmSettings::default()
    };
    let mut problem = Reprojection { samples, used, free, matrix: DMatrix::zeros(0, 0), rhs: DVector::zeros(0) };
    minimize(&mut problem, start, &settings)
}
