//! Information of a pixel's measurements about its depth.

/// The information of a pixel's measurements about the unknown in the last step, and what its residuals tell of their
/// noise. A robust loss gives every residual r the influence ψ(r); the solution moves by as much as the sum of
/// influences is, over its slope (Huber, *Robust Statistics*, 1981).
#[derive(Clone, Copy, Debug, Default)]
pub struct Information {
    /// Information Σ ψ' J² about the unknown. It may be negative at an outlier, and is not on average.
    pub h: f32,
    /// Square of the influence per measurement, ψ² over the noise model's variance.
    pub influence: f32,
    /// Slope of the influence per measurement, ψ': 1 where the loss is not robust. The mean of [`Self::influence`] around
    /// a pixel over that of this is the ratio of the noise's variance in the solution to what the information says.
    pub slope: f32,
}

impl Information {
    /// The information of measurements whose loss is not robust.
    pub fn plain(h: f32, chi2: f32) -> Self {
        Self { h, influence: chi2, slope: 1.0 }
    }

    /// The information of `n` measurements under the loss ρ(χ²) = χ²/(1 + χ²/c) of Geman and McClure, whose residuals
    /// have the weight w = (1 + χ²/c)⁻². `h` is Σ w J², `chi2` that per measurement, `over_cut` is χ²/c.
    pub fn robust(h: f32, chi2: f32, over_cut: f32, n: f32) -> Self {
        let weight = (1.0 + over_cut).powi(-2);
        // A residual lowers the weight of all: ψ' = w + r ∂w/∂r, along one of n directions that are alike.
        let along = 1.0 - 4.0 / n.max(1.0) * over_cut / (1.0 + over_cut);
        Self { h: h * along, influence: chi2 * weight * weight, slope: weight * along }
    }
}
