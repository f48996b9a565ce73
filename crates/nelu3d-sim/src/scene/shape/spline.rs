//! Cubic polynomials and splines of them.

/// Returns `Σ c_k x^k`.
pub(super) fn cubic(c: &[f64; 4], x: f64) -> f64 {
    c[0] + x * (c[1] + x * (c[2] + x * c[3]))
}

/// Returns the coefficients in s of `Σ c_k (x0 + d s)^k`.
pub(super) fn substitute_linear(c: &[f64; 4], x0: f64, d: f64) -> [f64; 4] {
    let c1 = c[1] + x0 * (2.0 * c[2] + x0 * 3.0 * c[3]);
    let c2 = c[2] + x0 * 3.0 * c[3];
    [cubic(c, x0), c1 * d, c2 * d * d, c[3] * d * d * d]
}

/// Returns the natural cubic spline through `(x, y)`: its pieces' coefficients about their left knots. Thomas algorithm
/// for the second derivatives (de Boor, *A Practical Guide to Splines*, ch. IV).
pub(super) fn natural_spline(x: &[f64], y: &[f64]) -> Vec<[f64; 4]> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let slope: Vec<f64> = (0..n - 1).map(|i| (y[i + 1] - y[i]) / h[i]).collect();
    // Second derivatives m; m[0] = m[n − 1] = 0.
    let (mut upper, mut right) = (vec![0.0; n], vec![0.0; n]);
    for i in 1..n - 1 {
        let diagonal = 2.0 * (h[i - 1] + h[i]) - h[i - 1] * upper[i - 1];
        upper[i] = h[i] / diagonal;
        right[i] = (6.0 * (slope[i] - slope[i - 1]) - h[i - 1] * right[i - 1]) / diagonal;
    }
    let mut m = vec![0.0; n];
    for i in (1..n - 1).rev() {
        m[i] = right[i] - upper[i] * m[i + 1];
    }
    (0..n - 1)
        .map(|i| {
            let linear = slope[i] - h[i] * (2.0 * m[i] + m[i + 1]) / 6.0;
            [y[i], linear, 0.5 * m[i], (m[i + 1] - m[i]) / (6.0 * h[i])]
        })
        .collect()
}
