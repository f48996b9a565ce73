//! The phases of a step, measured.

use super::super::program::Call;
use super::super::timing::{Demand, seconds};
use super::training::SurfaceTraining;
use crate::device::DeviceError;

impl SurfaceTraining {
    /// Measures the phases of a step, for `budget` seconds each: name, seconds, demand. Returns the seconds of a whole
    /// step. The training is of no use after it.
    pub(in super::super) fn measure(
        &mut self,
        budget: f64,
        n_samples: usize,
        mut phase: impl FnMut(&'static str, f64, Demand),
    ) -> Result<f64, DeviceError> {
        let n = n_samples as f64;
        // The table's update clears what the scatter left, so the two are measured together.
        const PHASES: [(&str, &[&str]); 8] = [
            ("draw and codewords", &["begin", "draw", "draw_places", "draw_samples", "lattice"]),
            ("encode", &["encode"]),
            ("layers", &["layer", "thin", "tangents"]),
            ("layers, back", &["layer_back", "thin_back"]),
            ("slopes", &["slopes", "tangents_x"]),
            ("compositing", &["render"]),
            ("network's gradient", &["gradient", "sum", "network", "sharpness"]),
            ("table's gradient, Adam", &["scatter", "table"]),
        ];
        let all: Vec<&Call> = self.calls.draw.iter().chain(&self.calls.step).collect();
        for (name, labels) in PHASES {
            let mut calls: Vec<Call> =
                all.iter().filter(|c| labels.contains(&c.label())).map(|c| (*c).clone()).collect();
            if labels.contains(&"scatter") {
                // The scatter adds to the table's gradient; both nets' tables come after both scatters otherwise.
                calls.sort_by_key(|c| c.label() == "table");
            }
            let secs = seconds(&self.gpu, &[&calls], budget)?;
            phase(name, secs, self.demand(name, n));
        }
        let steps = seconds(&self.gpu, &[&self.calls.draw, &self.calls.step], budget)?;
        Ok(steps)
    }

    /// Returns what a phase asks of the device for `n` samples, by the surface's net alone (the ambient one is small).
    fn demand(&self, phase: &str, n: f64) -> Demand {
        let work = self.net.work();
        let k = (self.buffers.colors.len() / self.net.capacity) as f64;
        let (inner, macs) = (work.inner_macs, work.macs);
        let (flops, bytes) = match phase {
            // 64 nodes of k values.
            "draw and codewords" => (n * 128.0 * k, n * (4.0 * 64.0 * k + 16.0)),
            "encode" => (n * work.corner_values * 2.0, n * 4.0 * (work.corner_values + work.n_inputs)),
            // Values and tangents.
            "layers" => (2.0 * n * (macs + inner), n * 4.0 * 2.0 * work.unit_values),
            "layers, back" => (2.0 * n * macs, n * 4.0 * work.unit_values),
            // The slopes of every sample, and the way back along them.
            "slopes" => (4.0 * n * work.corner_values, n * 4.0 * (2.0 * work.corner_values + 2.0 * work.n_inputs)),
            "compositing" => (n * 120.0, n * 4.0 * (2.0 + 12.0 + 3.0 + 2.0 * k)),
            "network's gradient" => (2.0 * n * macs, n * 4.0 * work.unit_values),
            // A value is read, added to and written; the table's gradient is read once, and its touched entries
            // updated.
            _ => {
                let touched = (n * work.corner_values).min(work.n_table);
                (n * work.corner_values * 2.0, 4.0 * (2.0 * n * work.corner_values + work.n_table + 7.0 * touched))
            }
        };
        Demand { flops, bytes }
    }
}
