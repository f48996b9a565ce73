//! Curves that rise from 0 to 1, with more and more parameters.

use super::rows::NODES;
use crate::image::Response;

/// A family of curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CurveModel {
    /// Light is the code.
    Linear,
    /// That of sRGB.
    Srgb,
    /// A power of the code.
    Power,
    /// A slope of ((code + offset) / (1 + offset))^exponent, times the exponential of a polynomial of this degree.
    PowerTimes(usize),
}

impl CurveModel {
    /// All, simplest first.
    pub(super) const ALL: [Self; 7] = [
        Self::Linear,
        Self::Srgb,
        Self::Power,
        Self::PowerTimes(0),
        Self::PowerTimes(1),
        Self::PowerTimes(2),
        Self::PowerTimes(3),
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
            Self::Power => "power",
            Self::PowerTimes(0) => "power with offset",
            Self::PowerTimes(_) => "power with offset, bent",
        }
    }

    /// Number of parameters.
    pub(super) fn parameters(self) -> usize {
        match self {
            Self::Linear | Self::Srgb => 0,
            Self::Power => 1,
            Self::PowerTimes(degree) => 2 + degree,
        }
    }

    /// Parameters to begin with: exponent of the slope, logarithm of the offset, coefficients.
    pub(super) fn start(self) -> Vec<f64> {
        let mut start = vec![0.8, 0.05f64.ln(), 0.0, 0.0, 0.0];
        start.truncate(self.parameters());
        start
    }

    /// Returns the light of every node; `None` for parameters out of their range.
    pub(super) fn light(self, p: &[f64]) -> Option<Vec<f64>> {
        let code = |i: usize| i as f64 / (NODES - 1) as f64;
        match self {
            Self::Linear => return Some((0..NODES).map(code).collect()),
            Self::Srgb => return Some((0..NODES).map(|i| Response::Srgb.light(code(i))).collect()),
            Self::Power if !(-0.9..=4.0).contains(&p[0]) => return None,
            // The integral of the slope, which is steep or flat at 0.
            Self::Power => return Some((0..NODES).map(|i| code(i).powf(1.0 + p[0])).collect()),
            Self::PowerTimes(_) => {}
        }
        let within = |v: &f64, limit: f64| v.abs() <= limit;
        if !within(&p[0], 4.0) || !(-9.0..=0.0).contains(&p[1]) || !p[2..].iter().all(|b| within(b, 5.0)) {
            return None;
        }
        let offset = p[1].exp();
        let slope = |c: f64| {
            let x = 2.0 * c - 1.0;
            // Legendre's polynomials of degree 1 to 3.
            let bend = [x, 1.5 * x * x - 0.5, 2.5 * x * x * x - 1.5 * x];
            let bend: f64 = p[2..].iter().zip(bend).map(|(b, l)| b * l).sum();
            ((c + offset) / (1.0 + offset)).powf(p[0]) * bend.exp()
        };
        let mut light = vec![0.0; NODES];
        for i in 1..NODES {
            // The midpoints of quarters.
            let part = (0..4).map(|q| slope((i as f64 - 1.0 + (q as f64 + 0.5) / 4.0) / (NODES - 1) as f64));
            light[i] = light[i - 1] + part.sum::<f64>();
        }
        let full = light[NODES - 1];
        light.iter_mut().for_each(|v| *v /= full);
        full.is_finite().then_some(light)
    }
}
