//! A color field as a network: its state, and what of it a checkpoint holds.

use serde::{Deserialize, Serialize};

use super::contract::Network;
use super::samples::{SampleBatch, TrainingSamples};
use super::spline::spline_through;
use crate::color_field::grid::Grid;
use crate::progress::Progress;

/// The description of a form with a network in a checkpoint: settings `S` and the configuration `C` that follows from
/// them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkShape<S, C> {
    /// Settings.
    pub settings: S,
    /// Pattern channels.
    pub k: usize,
    /// Encoding and network.
    pub config: C,
    /// Number of parameters.
    pub n_params: usize,
}

/// A color field as a network `N` with settings `S`.
#[derive(Clone, Debug)]
pub struct NetworkForm<S, N: Network> {
    shape: NetworkShape<S, N::Config>,
    network: N,
    trained: bool,
}

impl<S, N: Network> NetworkForm<S, N> {
    /// Initializes a form whose configuration follows from its settings.
    ///
    /// # Panics
    ///
    /// If the configuration is invalid.
    pub(in crate::color_field) fn untrained(settings: S, config: N::Config, k: usize, seed: u64) -> Self {
        let network = N::new(config.clone(), seed).expect("settings make a valid configuration");
        let shape = NetworkShape { settings, k, config, n_params: network.params().len() };
        Self { shape, network, trained: false }
    }

    /// Takes a form from a checkpoint; `None` when shape and parameters do not fit each other.
    pub fn from_params(shape: NetworkShape<S, N::Config>, params: Vec<f32>) -> Option<Self> {
        let network = N::from_params(shape.config.clone(), params).ok()?;
        (network.n_outputs() == shape.k).then_some(Self { shape, network, trained: true })
    }

    /// Returns the number of pattern channels.
    pub fn k(&self) -> usize {
        self.shape.k
    }

    /// Returns what identifies the form in a checkpoint.
    pub fn shape(&self) -> &NetworkShape<S, N::Config> {
        &self.shape
    }

    /// Returns all parameters.
    pub fn params(&self) -> &[f32] {
        self.network.params()
    }

    /// Returns whether the form was trained before.
    pub(in crate::color_field) fn is_trained(&self) -> bool {
        self.trained
    }

    /// Returns the network.
    pub fn network(&self) -> &N {
        &self.network
    }

    /// Returns the network, to be trained.
    #[cfg(feature = "gpu")]
    pub(in crate::color_field) fn network_mut(&mut self) -> &mut N {
        &mut self.network
    }

    /// Gives the network a new optimizer, and keeps its parameters.
    pub(in crate::color_field) fn begin_training(&mut self, config: N::Config) {
        let params = self.network.params().to_vec();
        self.network = N::from_params(config, params).expect("the layout did not change");
    }

    /// Takes `steps` steps of at least `batch` samples on the CPU, until the caller stops the work.
    pub(in crate::color_field) fn train_on_cpu(
        &mut self,
        samples: &mut TrainingSamples,
        batch: usize,
        steps: usize,
        progress: &Progress,
    ) {
        let mut drawn = SampleBatch::default();
        for step in 0..steps {
            progress.tick(step, steps);
            if progress.cancelled() {
                break;
            }
            samples.draw(batch, &mut drawn);
            self.network.train_step(&drawn.points, &drawn.targets, &drawn.weights);
        }
    }

    /// Drops the optimizer.
    pub(in crate::color_field) fn finish_training(&mut self) {
        self.network.finish_training();
        self.trained = true;
    }

    /// Returns the spline through the form's values at the corners of a volume of that many cells.
    pub(in crate::color_field) fn spline(&self, cells: [usize; 3]) -> Grid {
        spline_through(cells, self.shape.k, |points, values| self.network.query(points, values))
    }

    /// Returns the spline through the form's values at the corners of the volume's cells, for a network whose inputs
    /// are not the volume's coordinates but `place` of them.
    pub(in crate::color_field) fn spline_at(&self, cells: [usize; 3], place: impl Fn([f32; 3]) -> [f32; 3]) -> Grid {
        spline_through(cells, self.shape.k, |points, values| {
            let points: Vec<[f32; 3]> = points.iter().map(|q| place(*q)).collect();
            self.network.query(&points, values);
        })
    }
}
