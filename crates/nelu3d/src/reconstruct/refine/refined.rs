//! The result of the refinement.

use crate::sensor::CrosstalkMatrix;

/// A refined surface. All maps have the whole image's size, row by row.
pub struct Refined {
    /// Inverse depth 1/z, 1/mm; NaN where there is none.
    pub(crate) inv_z: Vec<f32>,
    /// Standard deviation of the inverse depth, 1/mm (`uncertainty.rs`).
    pub(crate) sigma: Vec<f32>,
    /// Fraction, mean over color channels, of the light that did not come directly from the light source.
    pub(crate) ambient: Vec<f32>,
    /// The part of it whose origin is not seen: all but what is gathered from the surface itself.
    pub unseen: Vec<f32>,
    /// χ² per measurement of a pixel.
    pub chi2: Vec<f32>,
    /// Root mean square residual of the normalized intensities.
    pub(crate) residual: Vec<f32>,
    /// Median absolute residual of the normalized intensities.
    pub(crate) abs_residual: Vec<f32>,
    /// The loss after every step: mean robust χ² per measurement.
    pub(crate) losses: Vec<f32>,
    /// Albedo per color channel, as far as interreflection determines it; 0 without gathered light.
    pub(crate) albedo: Vec<f32>,
    /// Where the flash is from the patterns' light, mm in the camera's frame; `None` where it was not asked for.
    pub(crate) flash_offset_mm: Option<[f64; 3]>,
    /// Crosstalk that the measurements were not cleared of; `None` where it was not asked for.
    pub(crate) crosstalk: Option<CrosstalkMatrix>,
}

impl Refined {
    /// Makes maps of `n` pixels without a surface at any of them.
    pub fn empty(n: usize, losses: Vec<f32>, albedo: Vec<f32>) -> Self {
        let nan = || vec![f32::NAN; n];
        Self {
            inv_z: nan(),
            sigma: nan(),
            ambient: vec![0.0; n],
            unseen: vec![0.0; n],
            chi2: nan(),
            residual: nan(),
            abs_residual: nan(),
            losses,
            albedo,
            flash_offset_mm: None,
            crosstalk: None,
        }
    }
}
