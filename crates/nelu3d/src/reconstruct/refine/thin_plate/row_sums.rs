//! Sums over the pixels of a row.

/// Number of partial sums that are taken side by side, as vector units do.
const SUMS: usize = 16;

/// Returns Σ a b of a row.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0f32; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let rest: f32 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for l in 0..SUMS {
            sums[l] += a[l] * b[l];
        }
    }
    f64::from(rest + sums.iter().sum::<f32>())
}

/// Returns Σ w a² of a row.
pub(super) fn weighted_square(a: &[f32], weight: &[f32]) -> f64 {
    let mut sums = [0.0f32; SUMS];
    let (a, weight) = (a.chunks_exact(SUMS), weight.chunks_exact(SUMS));
    let rest: f32 = a.remainder().iter().zip(weight.remainder()).map(|(a, w)| w * a * a).sum();
    for (a, w) in a.zip(weight) {
        for l in 0..SUMS {
            sums[l] += w[l] * a[l] * a[l];
        }
    }
    f64::from(rest + sums.iter().sum::<f32>())
}
