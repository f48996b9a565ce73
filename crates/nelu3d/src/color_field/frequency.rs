//! Form `frequency`: sines and cosines of the coordinates in octaves, and a network, over the unit cube of a
//! [`FieldFrame`](super::frame::FieldFrame) (paper, Fig. 3; the encoding is Eq. 4 of NeRF).
//!
//! The paper's 20 octaves reach 2^18 periods across the volume, far beyond what samples a pixel apart, and a few planes
//! along the light's rays, can supervise: those octaves are noise to the network, and along w they put wiggles between
//! the board positions. So by default an axis has only the octaves that its cells resolve. [`Octaves::Paper`] keeps all
//! 20.
//!
//! The paper gives no size for the network, and NeRF's 8 × 256 would train for an hour here. Ours is 4 × 64: with it
//! the paper's 5,000 steps reach the quality of the other forms on `dlp` (docs/color-field-forms.md).

use nelu3d_field::{FrequencyField, FrequencyFieldConfig};
use serde::{Deserialize, Serialize};

use super::bins::Bins;
use super::grid::Grid;
use super::network::{NetworkForm, NetworkShape, TrainingSamples};
use crate::progress::Progress;

/// Length of a second training relative to the first.
const AGAIN: f64 = 0.3;
/// Learning rate of a second training relative to the first.
const AGAIN_RATE: f64 = 0.3;

/// The octaves that coordinates are encoded in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Octaves {
    /// As many octaves per axis as the sweep supervises
    Supervised,
    /// 20 octaves on every axis, as in the paper
    Paper,
}

/// Settings of a [`FrequencyForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrequencySettings {
    /// Cells of the volume along a, b and w.
    pub cells: [usize; 3],
    /// Octaves of the encoding.
    pub octaves: Octaves,
    /// Number of steps of a training.
    pub steps: usize,
    /// Number of points per step.
    pub batch: usize,
}

impl FrequencySettings {
    /// Returns the settings of a volume of that many cells: 5,000 steps, as in the paper.
    pub fn for_cells(cells: [usize; 3], octaves: Octaves) -> Self {
        Self { cells, octaves, steps: 5000, batch: 2048 }
    }

    fn config(&self, k: usize) -> FrequencyFieldConfig {
        let mut config = FrequencyFieldConfig::paper(k);
        if self.octaves == Octaves::Supervised {
            // The finest octave of n has 2^(n − 2) periods: at least four cells each.
            config.n_frequencies = self.cells.map(|c| c.max(1).ilog2() as usize);
        }
        config.width = 64;
        config.learning_rate = 3e-3;
        config.schedule.final_factor = 0.01;
        config
    }
}

/// The description of a [`FrequencyForm`] in a checkpoint.
pub type FrequencyShape = NetworkShape<FrequencySettings, FrequencyFieldConfig>;

/// A color field as frequency encoding and network.
pub type FrequencyForm = NetworkForm<FrequencySettings, FrequencyField>;

impl FrequencyForm {
    /// Initializes a form.
    pub fn new(settings: FrequencySettings, k: usize, seed: u64) -> Self {
        let config = settings.config(k);
        Self::untrained(settings, config, k, seed)
    }

    /// Trains on the samples that the bins stand for, in random order, each weighed by its precision relative to the
    /// others. A form that was trained before goes on from its parameters, with a shorter schedule and a lower rate.
    pub fn train(&mut self, bins: &Bins, seed: u64, progress: &Progress) {
        let Some(mut samples) = TrainingSamples::new(bins, 1, seed) else { return };
        let (length, rate) = if self.is_trained() { (AGAIN, AGAIN_RATE) } else { (1.0, 1.0) };
        let FrequencySettings { steps, batch, .. } = self.shape().settings;
        let steps = (steps as f64 * length).ceil() as usize;
        let mut config = self.shape().config.clone();
        config.schedule.n_steps = steps as u64;
        config.learning_rate *= rate;
        self.begin_training(config);
        self.train_on_cpu(&mut samples, batch, steps, progress);
        self.finish_training();
    }

    /// Returns the spline through the form's values at the corners of the volume's cells.
    pub fn to_grid(&self) -> Grid {
        self.spline(self.shape().settings.cells)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS: [usize; 3] = [32, 24, 4];

    fn expected(q: [f32; 3]) -> [f32; 2] {
        [0.5 + 0.3 * (12.0 * q[0] + 3.0 * q[1]).sin(), 0.5 + (0.2 + 0.1 * q[2]) * (10.0 * q[1]).cos()]
    }

    fn bins() -> Bins {
        let mut bins = Bins::new([CELLS[0], CELLS[1], 12], 2);
        for w in (0..12).map(|i| (i as f32 + 0.5) / 12.0).filter(|w| !(0.45..0.55).contains(w)) {
            for i in 0..96 * 72 {
                let q = [((i % 96) as f32 + 0.5) / 96.0, ((i / 96) as f32 + 0.5) / 72.0, w];
                bins.add(q, &expected(q), &[1.0; 2]);
            }
        }
        bins
    }

    #[test]
    fn octaves_that_are_supervised_interpolate_a_held_out_slab() {
        let settings =
            FrequencySettings { steps: 2500, batch: 512, ..FrequencySettings::for_cells(CELLS, Octaves::Supervised) };
        assert_eq!(settings.config(2).n_frequencies, [5, 4, 2]);
        let mut form = FrequencyForm::new(settings, 2, 3);
        form.train(&bins(), 3, &Progress::none());
        let grid = form.to_grid();
        let (mut sum, mut v) = (0.0, [0.0; 2]);
        for i in 0..1000 {
            let at = |step: f32| 0.03 + 0.94 * (i as f32 * step).fract();
            let q = [at(0.618_034), at(0.754_878), 0.45 + 0.1 * at(0.569_84)];
            grid.eval(q, &mut v);
            sum += v.iter().zip(expected(q)).map(|(v, t)| (v - t) * (v - t)).sum::<f32>() / 2000.0;
        }
        // The signal's own deviation from its mean is about 0.2.
        assert!(sum.sqrt() < 0.03, "{}", sum.sqrt());
    }

    #[test]
    fn parameters_restore_the_form_and_nothing_else_does() {
        let form = FrequencyForm::new(FrequencySettings::for_cells([6, 5, 1], Octaves::Paper), 3, 1);
        assert_eq!(form.shape().config.n_frequencies, [20; 3]);
        let again = FrequencyForm::from_params(form.shape().clone(), form.params().to_vec()).unwrap();
        assert_eq!(form.to_grid(), again.to_grid());
        assert!(FrequencyForm::from_params(form.shape().clone(), form.params()[1..].to_vec()).is_none());
        let shape = FrequencyShape { k: 2, ..form.shape().clone() };
        assert!(FrequencyForm::from_params(shape, form.params().to_vec()).is_none());
    }
}
