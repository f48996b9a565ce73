//! Gradients of the parameters, and the step of the optimizer.

use super::super::adapter::Gpu;
use super::super::program::{Binding, Call, Kernels, folded};
use super::layout::{N_CHUNKS, Net};
use super::shared::{Back, Shared};
use crate::adam::{AdamConfig, MomentBuffers};
use crate::device::DeviceError;
use crate::field::HashField;
use crate::field::training::Training;

const LEVEL: &str = include_str!("../shaders/level.wgsl");
const ADAM: &str = include_str!("../shaders/adam.wgsl");

impl Net {
    /// Returns the calls for the gradients of all parameters and the step of the optimizer.
    pub(in super::super) fn descend(
        &self,
        gpu: &Gpu,
        kernels: &mut Kernels,
        shared: &Shared,
        back: Back<'_>,
    ) -> Result<Vec<Call>, DeviceError> {
        let Shared { control, rates, .. } = *shared;
        let t = self.training();
        let mut calls = Vec::new();
        let layers = self.layers();
        for (l, &layer) in layers.iter().enumerate() {
            let (n_in, n_out, _) = layer;
            let is_last = l + 1 == layers.len();
            let input = if l == 0 { &self.x } else { &self.hidden[l - 1] };
            let d = if is_last { &t.d_out } else { &t.d_hidden[l] };
            let scale = match back {
                Back::Outputs => None,
                Back::Distance { s, .. } => Some(s),
            };
            let ones = is_last && scale.is_some();
            let mut bindings: Vec<&dyn Binding> = vec![control, input, &t.partial];
            if !ones {
                bindings.push(d);
            }
            bindings.extend(scale.map(|s| s as &dyn Binding));
            let constants = self.layer_constants(shared, layer);
            let constants = constants.flag("ONES", ones).flag("SCALED", scale.is_some() && !ones);
            let (form, groups) = if kernels.gpu().tiles {
                (include_str!("../shaders/gradient.wgsl"), [N_CHUNKS, n_out.div_ceil(64), n_in.div_ceil(64)])
            } else {
                (include_str!("../shaders/gradient_plain.wgsl"), [N_CHUNKS, n_in.div_ceil(32), n_out.div_ceil(4)])
            };
            let source = [include_str!("../shaders/gradient_ends.wgsl"), form].concat();
            calls.push(kernels.run("gradient", &source, &constants, groups, &bindings)?);
        }

        let source = [LEVEL, include_str!("../shaders/scatter.wgsl")].concat();
        let constants = self.constants(shared).flag("F32_ATOMICS", gpu.f32_atomics);
        let mut bindings: Vec<&dyn Binding> = vec![&t.d_table, control, &self.levels, &self.points, &t.d_x];
        if let Back::Distance { s, u } = back {
            bindings.extend([s as &dyn Binding, u]);
        }
        let constants = constants.flag("TANGENTS", matches!(back, Back::Distance { .. }));
        let groups = [self.capacity / 64, self.n_levels, 1];
        calls.push(kernels.run("scatter", &source, &constants, groups, &bindings)?);

        let AdamConfig { beta1, beta2, epsilon } = t.settings.adam;
        let constants = self.constants(shared).value("BETA1", beta1).value("BETA2", beta2).value("EPSILON", epsilon);
        let source = [ADAM, include_str!("../shaders/table.wgsl")].concat();
        let [first, second] = &t.table_moments;
        let bindings: &[&dyn Binding] = &[rates, &t.d_table, &self.table, first, second];
        calls.push(kernels.run("table", &source, &constants, folded(self.table.len(), 256), bindings)?);

        let n_params = self.weights.len();
        let groups = [n_params.div_ceil(64), 1, 1];
        let sum = include_str!("../shaders/sum.wgsl");
        calls.push(kernels.run("sum", sum, &self.constants, groups, &[&t.partial, &t.gradient])?);
        let source = [ADAM, include_str!("../shaders/network.wgsl")].concat();
        let constants = constants.count("N_UNITS", t.units.len()).flag("NORMALIZED", t.settings.weight_normalization);
        let [first, second] = &t.network_moments;
        let bindings: &[&dyn Binding] = &[rates, &t.units, &t.gradient, &self.weights, &t.raw, first, second];
        calls.push(kernels.run("network", &source, &constants, [t.units.len().div_ceil(64), 1, 1], bindings)?);
        Ok(calls)
    }

    /// Brings parameters and optimizer back into the field they came from.
    pub(in super::super) fn fetch<const D: usize>(
        &self,
        gpu: &Gpu,
        n_steps: u64,
        field: &mut HashField<D>,
    ) -> Result<(), DeviceError> {
        let t = self.training();
        let table = gpu.read(&self.table, self.table.len())?;
        let weights = gpu.read(&self.weights, self.weights.len())?;
        let moment = |i: usize| -> Result<Vec<f32>, DeviceError> {
            let mut all = gpu.read(&t.table_moments[i], self.table.len())?;
            all.extend(gpu.read(&t.network_moments[i], t.n_raw)?);
            Ok(all)
        };
        let moments = MomentBuffers { first: moment(0)?, second: moment(1)? };
        let raw = if t.settings.weight_normalization { gpu.read(&t.raw, t.n_raw)? } else { Vec::new() };
        field.params[..table.len()].copy_from_slice(&table);
        field.params[table.len()..].copy_from_slice(&weights);
        field.packed.pack(&weights);
        field.training = Some(Box::new(Training::restored(n_steps, moments, raw)));
        Ok(())
    }
}
