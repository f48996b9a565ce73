//! χ² of a codeword of the color field as an explanation of a measured one.

use nelu3d_field::cost_volume;

use crate::sensor::Measurements;

/// Returns the χ² at which costs saturate: beyond it a codeword is simply wrong (an outlier), however wrong.
pub(crate) fn saturation(m: &Measurements) -> f32 {
    9.0 * m.independent
}

/// Returns χ² of pixel `i` at a point with codeword `c`, after the best fractions of ambient light and
/// interreflection, saturating for outliers.
#[inline]
pub(crate) fn chi2_of_codeword(m: &Measurements, i: usize, c: &[f32], prior: [f32; 2]) -> f32 {
    chi2_of_weighted(m, i, &m.inv_var[i * m.k..(i + 1) * m.k], c, prior)
}

/// Returns the same with other weights of the channels, `inv_var` of length k: one over their variances, or 0.
#[inline]
pub(crate) fn chi2_of_weighted(m: &Measurements, i: usize, inv_var: &[f32], c: &[f32], prior: [f32; 2]) -> f32 {
    let at = i * m.k..(i + 1) * m.k;
    cost_volume::misfit([&m.p[at.clone()], inv_var, &m.surround[at]], c, prior, saturation(m))
}
