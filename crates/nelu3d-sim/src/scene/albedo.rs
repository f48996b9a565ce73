//! Colors of diffuse surfaces.

use std::f64::consts::TAU;

use nalgebra::Point3;
use nelu3d_scan::board::Artwork;

use crate::spec::AlbedoSpec;

#[derive(Clone, Debug)]
pub(crate) enum Albedo {
    Constant([f32; 3]),
    Waves {
        from: [f32; 3],
        to: [f32; 3],
        per_mm: f64,
    },
    /// `dot_mm`: side of a printer's dot; 0 for exact edges.
    Board {
        artwork: Box<Artwork>,
        ink: f32,
        paper: f32,
        dot_mm: f64,
    },
}

impl Albedo {
    pub(crate) fn new(spec: &AlbedoSpec) -> Self {
        match *spec {
            AlbedoSpec::Constant { rgb } => Self::Constant(rgb.map(|v| v as f32)),
            AlbedoSpec::Waves { from, to, period_mm } => {
                Self::Waves { from: from.map(|v| v as f32), to: to.map(|v| v as f32), per_mm: TAU / period_mm }
            }
        }
    }

    /// Red, green and blue at a point of the object's frame.
    pub(crate) fn at(&self, p: &Point3<f64>) -> [f32; 3] {
        match self {
            Self::Constant(rgb) => *rgb,
            Self::Waves { from, to, per_mm } => {
                let waves = (p.x * per_mm).sin() + (p.y * per_mm + 1.0).sin() + (p.z * per_mm + 2.0).sin();
                let part = (0.5 + waves / 6.0) as f32;
                std::array::from_fn(|c| from[c] + part * (to[c] - from[c]))
            }
            Self::Board { artwork, ink, paper, dot_mm } => {
                // A dot is ink or paper as the artwork is at its center.
                let [x, y] = [p.x, p.y].map(|v| if *dot_mm > 0.0 { ((v / dot_mm).floor() + 0.5) * dot_mm } else { v });
                [ink + (paper - ink) * artwork.albedo(x, y); 3]
            }
        }
    }
}
