//! Homographies between planes, from four points or robustly from many.

use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, Vector3};

use super::robust::{Lcg, median};

/// Returns the homography that takes each of four points to its partner; `None` when three of them lie on a line.
pub(crate) fn homography_4pt(from: &[[f64; 2]; 4], to: &[[f64; 2]; 4]) -> Option<Matrix3<f64>> {
    dlt(from, to)
}

/// A plane-to-plane map fitted to points.
#[derive(Clone, Copy, Debug)]
pub struct Homography {
    /// Takes homogeneous points of the one plane to those of the other.
    pub matrix: Matrix3<f64>,
}

impl Homography {
    /// Fits a homography by least median of squares over random quadruples (seeded: the same points give the same
    /// answer), then least squares over the inliers. Survives almost half of the points being wrong. `None` for fewer
    /// than four points, or points on a line.
    ///
    /// # Panics
    ///
    /// If the lists differ in length.
    pub fn robust(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Self> {
        assert_eq!(from.len(), to.len());
        let n = from.len();
        if n < 4 {
            return None;
        }
        let all = dlt(from, to);
        if n < 6 {
            return all.map(|matrix| Self { matrix });
        }
        let residuals = |h: &Matrix3<f64>| -> Vec<f64> { (0..n).map(|i| residual(h, from[i], to[i])).collect() };
        let mut best = all.map(|h| (median(&residuals(&h)), h));
        let mut rng = Lcg::new(n as u64);
        for _ in 0..300 {
            let pick: [usize; 4] = std::array::from_fn(|_| rng.below(n));
            if (1..4).any(|k| pick[..k].contains(&pick[k])) {
                continue;
            }
            let Some(h) = four(&pick.map(|i| from[i]), &pick.map(|i| to[i])) else { continue };
            let m = median(&residuals(&h));
            if best.as_ref().is_none_or(|(b, _)| m < *b) {
                best = Some((m, h));
            }
        }
        let (mut scale, mut matrix) = best?;
        for _ in 0..4 {
            // Rayleigh: the median of the norm is 1.18 σ; 4.5 σ keeps all but 4e-5 of the good ones.
            let r = residuals(&matrix);
            let limit = (4.5 * scale / 1.1774).max(1e-12);
            let keep: Vec<usize> = (0..n).filter(|&i| r[i] <= limit).collect();
            let pick = |p: &[[f64; 2]]| keep.iter().map(|&i| p[i]).collect::<Vec<_>>();
            let Some(h) = dlt(&pick(from), &pick(to)) else { break };
            let m = median(&residuals(&h));
            if m > 1.5 * scale {
                break;
            }
            (scale, matrix) = (m, h);
        }
        Some(Self { matrix })
    }

    /// Takes a point of the one plane to the other.
    pub fn apply(&self, p: [f64; 2]) -> [f64; 2] {
        apply(&self.matrix, p)
    }
}

fn apply(h: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let q = h * Vector3::new(x, y, 1.0);
    [q.x / q.z, q.y / q.z]
}

fn residual(h: &Matrix3<f64>, from: [f64; 2], to: [f64; 2]) -> f64 {
    let q = apply(h, from);
    // Several times as fast as `hypot`, which guards against overflow.
    let r = ((q[0] - to[0]).powi(2) + (q[1] - to[1]).powi(2)).sqrt();
    if r.is_finite() { r } else { f64::MAX }
}

/// Returns the shift and scale that make points mean zero and mean norm √2 (Hartley 1997).
fn normalizer(p: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let n = p.len() as f64;
    let (cx, cy) = (p.iter().map(|q| q[0]).sum::<f64>() / n, p.iter().map(|q| q[1]).sum::<f64>() / n);
    let spread = p.iter().map(|q| (q[0] - cx).hypot(q[1] - cy)).sum::<f64>() / n;
    if !(spread > 0.0 && spread.is_finite()) {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / spread;
    Some(Matrix3::new(s, 0.0, -s * cx, 0.0, s, -s * cy, 0.0, 0.0, 1.0))
}

/// Solves the normalized direct linear transform (Hartley & Zisserman, algorithm 4.2), scaled to a positive last entry
/// at the points. `None` for degenerate points.
fn dlt(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    if from.len() < 4 {
        return None;
    }
    let (a, b) = (normalizer(from)?, normalizer(to)?);
    let rows = |i: usize| {
        let ([x, y], [u, v]) = (apply(&a, from[i]), apply(&b, to[i]));
        [[x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u], [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v]]
    };
    let h = if from.len() == 4 {
        // Eight equations for eight unknowns: a ninth row closes the system (the last entry may not be scaled to one).
        let mut m = SMatrix::<f64, 9, 9>::zeros();
        for i in 0..4 {
            for (k, row) in rows(i).iter().enumerate() {
                for (c, v) in row.iter().enumerate() {
                    m[(2 * i + k, c)] = *v;
                }
            }
        }
        let svd = m.svd(false, true);
        smallest(svd.singular_values.as_slice(), svd.v_t?.row_iter().map(|r| r.iter().copied().collect()).collect())?
    } else {
        let mut m = SMatrix::<f64, 9, 9>::zeros();
        for i in 0..from.len() {
            for row in rows(i) {
                let v = SVector::<f64, 9>::from(row);
                m += v * v.transpose();
            }
        }
        let eigen = m.symmetric_eigen();
        let vectors = (0..9).map(|c| eigen.eigenvectors.column(c).iter().copied().collect()).collect();
        // Eigenvalues are squared singular values.
        let values: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0).sqrt()).collect();
        smallest(&values, vectors)?
    };
    let h = DMatrix::from_row_slice(3, 3, &h);
    let h = Matrix3::from_iterator(h.iter().copied());
    let h = b.try_inverse()? * h * a;
    let at = from.iter().map(|p| (h * Vector3::new(p[0], p[1], 1.0)).z).sum::<f64>();
    let h = h * (at.signum() / h.norm());
    h.iter().all(|v| v.is_finite()).then_some(h)
}

/// Solves for the homography through four points by elimination, with the last entry 1 where the points' mean is the
/// origin: quick, and good enough to choose among samples.
fn four(from: &[[f64; 2]; 4], to: &[[f64; 2]; 4]) -> Option<Matrix3<f64>> {
    let (a, b) = (normalizer(from)?, normalizer(to)?);
    let (mut m, mut rhs) = (SMatrix::<f64, 8, 8>::zeros(), SVector::<f64, 8>::zeros());
    for i in 0..4 {
        let ([x, y], [u, v]) = (apply(&a, from[i]), apply(&b, to[i]));
        let rows = [[x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y], [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y]];
        for k in 0..2 {
            for c in 0..8 {
                m[(2 * i + k, c)] = rows[k][c];
            }
        }
        (rhs[2 * i], rhs[2 * i + 1]) = (u, v);
    }
    let h = m.lu().solve(&rhs)?;
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0);
    let h = b.try_inverse()? * h * a;
    h.iter().all(|v| v.is_finite()).then_some(h)
}

/// Returns the vector of the smallest singular value, if the second smallest is clearly larger.
fn smallest(values: &[f64], vectors: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let unique = values[order[1]] > 1e-6 * values[order[8]];
    unique.then(|| vectors[order[0]].clone())
}
