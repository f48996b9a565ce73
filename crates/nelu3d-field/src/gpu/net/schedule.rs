//! Rates of the optimizer.

use crate::adam::Update;
use crate::field::TrainConfig;

/// Returns the rates of a net in every step of its schedule from `first` on: table, network, root of the bias
/// correction, and the rate of a parameter whose learning rate is 1.
pub(in super::super) fn schedule(settings: &TrainConfig, first: u64, n_steps: usize) -> Vec<[f32; 4]> {
    (first..first + n_steps as u64)
        .map(|step| {
            let factor = settings.schedule.factor(step);
            let table = Update::new(&settings.adam, settings.encoding_learning_rate * factor, step);
            let network = Update::new(&settings.adam, settings.network_learning_rate * factor, step);
            // The rate of a parameter whose learning rate is 1.
            let unit = Update::new(&settings.adam, factor, step);
            [table.rate as f32, network.rate as f32, table.root as f32, unit.rate as f32]
        })
        .collect()
}
