//! The ambient term A(u, v) of recipe `paper`.

use nelu3d_field::HashField;
use serde::{Deserialize, Serialize};

use super::config;
use crate::sensor::Measurements;

/// The ambient term (paper, Eq. 1, and Fig. 7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Ambient {
    /// `I_ambient = A · I_white` with A in [0, 1]: never brighter than white
    #[default]
    Bounded,
    /// `I_ambient` anywhere in [0, 1], whatever white is (an ablation of the paper's Fig. 7)
    Unbounded,
    /// None (an ablation of the paper's Fig. 7)
    None,
}

/// A small network over the image, one output per camera channel.
pub struct AmbientField {
    /// Meaning of the network's output.
    pub(super) kind: Ambient,
    /// The network.
    pub(super) field: HashField<2>,
}

/// White below which `I_ambient / I_white` stays that of this white.
pub(super) const MIN_WHITE: f32 = 1e-3;

impl AmbientField {
    /// Initializes the network.
    pub fn new(kind: Ambient, n_channels: usize, n_steps: usize, seed: u64) -> Self {
        let config = config::image_field_config(n_channels, n_steps);
        Self { kind, field: HashField::new(config, seed).expect("the published configuration is valid") }
    }

    /// Makes the fractions begin at 2 %. They begin at a half as published: beside a surface that is right already, all
    /// of them would have to fall, and the surface would move away for as long as they do.
    pub(super) fn darken(&mut self) {
        const LOGIT: f32 = -4.0;
        let mut params = self.field.params().to_vec();
        let n_biases = self.field.n_outputs();
        let first = params.len() - n_biases;
        params[first..].fill(LOGIT);
        let config = self.field.config().clone();
        self.field = HashField::from_params(config, params).expect("only the biases differ");
    }

    /// Evaluates the ambient fractions, `[ray][channel]`, at points in the unit square of the image, given I_white
    /// there, `[ray][channel]`.
    pub(super) fn query(&self, image_points: &[[f32; 2]], white: &[f32], out: &mut Vec<f32>) {
        out.clear();
        out.resize(white.len(), 0.0);
        match self.kind {
            Ambient::None => {}
            Ambient::Bounded => self.field.query(image_points, out),
            Ambient::Unbounded => {
                self.field.query(image_points, out);
                out.iter_mut().zip(white).for_each(|(a, w)| *a /= w.max(MIN_WHITE));
            }
        }
    }

    /// Takes one step of the optimizer, given the gradient by the fractions.
    pub(super) fn descend(&mut self, image_points: &[[f32; 2]], white: &[f32], d_fractions: &mut [f32]) {
        match self.kind {
            Ambient::None => return,
            Ambient::Bounded => {}
            Ambient::Unbounded => d_fractions.iter_mut().zip(white).for_each(|(d, w)| *d /= w.max(MIN_WHITE)),
        }
        self.field.descend(image_points, d_fractions);
    }

    /// Returns the ambient fractions of every pixel, `[pixel][channel]`.
    pub(super) fn fractions(&self, m: &Measurements) -> Vec<f32> {
        let image_points: Vec<[f32; 2]> = (0..m.n()).map(|i| image_point(m, i)).collect();
        let mut out = Vec::new();
        self.query(&image_points, &m.light, &mut out);
        out
    }
}

/// Returns a pixel's position in the unit square of the image.
pub(super) fn image_point(m: &Measurements, i: usize) -> [f32; 2] {
    [((i % m.width) as f32 + 0.5) / m.width as f32, ((i / m.width) as f32 + 0.5) / m.height as f32]
}
