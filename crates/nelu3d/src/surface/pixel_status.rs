//! The status of a pixel: valid, or why it was rejected.

use serde::Serialize;

/// The status of a pixel: valid, or why it has no depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum PixelStatus {
    /// The pixel has a depth.
    Valid = 0,
    /// The pixel lies outside the calibrated volume.
    OutsideVolume = 1,
    /// One of the pixel's images is clipped.
    Saturated = 2,
    /// The pixel is too dark, or in shadow.
    Underexposed = 3,
    /// The pixel has no consistent code: nothing in the calibrated volume explains what was measured.
    Ambiguous = 4,
    /// The pixel is next to a depth discontinuity, where it sees two surfaces, or at an outline, which covers less than
    /// half of it.
    DepthDiscontinuity = 5,
}

impl PixelStatus {
    /// Every status, in the order of its number.
    pub const ALL: [PixelStatus; 6] = [
        PixelStatus::Valid,
        PixelStatus::OutsideVolume,
        PixelStatus::Saturated,
        PixelStatus::Underexposed,
        PixelStatus::Ambiguous,
        PixelStatus::DepthDiscontinuity,
    ];

    /// Returns whether the pixel's images are neither too dark nor clipped.
    pub fn is_measured(self) -> bool {
        !matches!(self, PixelStatus::Underexposed | PixelStatus::Saturated)
    }

    /// Returns the status's key in `result.json`, which is stable.
    pub fn key(self) -> &'static str {
        match self {
            PixelStatus::Valid => "kept",
            PixelStatus::OutsideVolume => "outside",
            PixelStatus::Saturated => "clipped",
            PixelStatus::Underexposed => "dark",
            PixelStatus::Ambiguous => "ambiguous",
            PixelStatus::DepthDiscontinuity => "edge",
        }
    }

    /// Returns the status in words.
    pub fn label(self) -> &'static str {
        match self {
            PixelStatus::Valid => "has a depth",
            PixelStatus::OutsideVolume => "outside the calibrated volume",
            PixelStatus::Saturated => "saturated",
            PixelStatus::Underexposed => "underexposed or in shadow",
            PixelStatus::Ambiguous => "no consistent code",
            PixelStatus::DepthDiscontinuity => "next to a depth discontinuity",
        }
    }

    /// Returns the percentages of underexposed, saturated, outside and ambiguous pixels in words, for a message that
    /// says why nothing was reconstructed; `volume` names what the pixels are outside of.
    pub fn describe_rejections(status: &[PixelStatus], volume: &str) -> String {
        let percent = |s: PixelStatus| status.iter().filter(|v| **v == s).count() as f64 / status.len() as f64 * 100.0;
        format!(
            "{:.0} % of the pixels are too dark, {:.0} % clipped, {:.0} % outside {volume}, {:.0} % without a \
             consistent code",
            percent(PixelStatus::Underexposed),
            percent(PixelStatus::Saturated),
            percent(PixelStatus::OutsideVolume),
            percent(PixelStatus::Ambiguous)
        )
    }
}
