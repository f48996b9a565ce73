//! Information of a pixel's measurements about its depth.

/// The information of a pixel's measurements about the unknown in the last step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Information {
    /// Information Σ w J² about the unknown.
    pub h: f32,
    /// χ² per measurement: its mean around a pixel is the ratio of the noise's variance to that of the noise model.
    pub chi2: f32,
}
