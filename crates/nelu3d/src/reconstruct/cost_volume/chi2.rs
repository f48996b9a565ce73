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
    let at = i * m.k..(i + 1) * m.k;
    let measured = [&m.p, &m.inv_var, &m.surround].map(|v| &v[at.clone()]);
    cost_volume::misfit(measured, c, prior, saturation(m))
}
