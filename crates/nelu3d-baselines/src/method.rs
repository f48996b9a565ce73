//! The methods by name.

use serde::{Deserialize, Serialize};

/// How the patterns are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Binary codes (Gray, binary, XOR), with or without inverses; edges between stripes found to sub-pixel.
    Gray,
    /// Phase shifting: three or more shifts of each frequency, unwrapped over the frequencies.
    Phase,
    /// Micro phase shifting (Gupta & Nayar 2012): three shifts of one frequency, one image of each other.
    Mps,
    /// Zero-mean normalized cross-correlation with the codewords of the columns: any patterns, three images or more.
    Zncc,
    /// TurboSL (Mirdehghan et al. 2024): a signed distance field, albedo, ambient light and blur by inverse rendering.
    #[cfg_attr(feature = "clap", value(name = "turbosl"))]
    #[serde(rename = "turbosl")]
    TurboSl,
    /// LookUp3D: the nearest codeword of the sweep's table; needs no projector.
    #[cfg_attr(feature = "clap", value(name = "lookup3d"))]
    #[serde(rename = "lookup3d")]
    Lookup3d,
    /// LookUp3D with the table as products of factors.
    #[cfg_attr(feature = "clap", value(name = "lookup3d-lowrank"))]
    #[serde(rename = "lookup3d-lowrank")]
    Lookup3dLowrank,
}

impl Method {
    /// Whether it triangulates with a calibrated projector.
    pub fn needs_projector(self) -> bool {
        !matches!(self, Method::Lookup3d | Method::Lookup3dLowrank)
    }

    /// Returns the name of the method on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Method::Gray => "gray",
            Method::Phase => "phase",
            Method::Mps => "mps",
            Method::Zncc => "zncc",
            Method::TurboSl => "turbosl",
            Method::Lookup3d => "lookup3d",
            Method::Lookup3dLowrank => "lookup3d-lowrank",
        }
    }
}
