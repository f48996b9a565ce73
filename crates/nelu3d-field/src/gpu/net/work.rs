//! The work of a net.

use super::layout::Net;

/// The work of a net per point.
pub(in super::super) struct Work {
    /// Number of weights.
    pub(in super::super) macs: f64,
    /// Number of weights of all layers but the last.
    pub(in super::super) inner_macs: f64,
    /// Inputs of the network.
    pub(in super::super) n_inputs: f64,
    /// Values that the layers read and write.
    pub(in super::super) unit_values: f64,
    /// Values of the table that a point is interpolated from.
    pub(in super::super) corner_values: f64,
    /// Length of the table.
    pub(in super::super) n_table: f64,
}

impl Net {
    /// Returns the work of the net per point.
    pub(in super::super) fn work(&self) -> Work {
        let layers = self.layers();
        let macs = |layers: &[(usize, usize, usize)]| layers.iter().map(|(i, o, _)| i * o).sum::<usize>() as f64;
        Work {
            macs: macs(&layers),
            inner_macs: macs(&layers[..layers.len() - 1]),
            n_inputs: self.mlp.n_inputs as f64,
            unit_values: layers.iter().map(|(i, o, _)| i + o).sum::<usize>() as f64,
            corner_values: 8.0 * self.mlp.n_inputs as f64,
            n_table: self.table.len() as f64,
        }
    }
}
