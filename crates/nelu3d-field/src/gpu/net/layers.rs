//! Forward and back through the layers.

use super::super::program::{Binding, Buffer, Call, Constants, Kernels};
use super::layout::Net;
use super::shared::Shared;
use crate::device::DeviceError;
use crate::mlp::Activation;

const LEVEL: &str = include_str!("../shaders/level.wgsl");
/// Outputs up to which a layer is worked on point by point.
const THIN: usize = 8;

impl Net {
    /// Returns the call of a layer: see the shaders.
    fn layer(
        &self,
        kernels: &mut Kernels,
        label: &'static str,
        constants: &Constants,
        n_out: usize,
        bindings: &[&dyn Binding],
    ) -> Result<Call, DeviceError> {
        let tiled = include_str!("../shaders/layer.wgsl");
        let plain = include_str!("../shaders/layer_plain.wgsl");
        let (form, per_group) = if kernels.gpu().tiles { (tiled, 64) } else { (plain, 4) };
        let source = [include_str!("../shaders/layer_ends.wgsl"), form].concat();
        kernels.run(label, &source, constants, [self.capacity / 64, n_out.div_ceil(per_group), 1], bindings)
    }

    /// Returns the calls from points to outputs.
    pub(in super::super) fn forward(&self, kernels: &mut Kernels, shared: &Shared) -> Result<Vec<Call>, DeviceError> {
        let Shared { control, .. } = *shared;
        let source = [LEVEL, include_str!("../shaders/encode.wgsl")].concat();
        let groups = [self.capacity / 64, self.n_levels, 1];
        let bindings: &[&dyn Binding] = &[control, &self.levels, &self.table, &self.points, &self.x];
        let mut calls = vec![kernels.run("encode", &source, &self.constants(shared), groups, bindings)?];
        let layers = self.layers();
        for (l, &layer) in layers.iter().enumerate() {
            let input = if l == 0 { &self.x } else { &self.hidden[l - 1] };
            let is_last = l + 1 == layers.len();
            let output = if is_last { &self.out } else { &self.hidden[l] };
            let sigmoid = is_last && self.mlp.output_activation == Activation::Sigmoid;
            let constants = self.layer_constants(shared, layer).flag("SIGMOID", sigmoid);
            if is_last && layer.1 <= THIN {
                let source = include_str!("../shaders/thin.wgsl");
                let bindings: &[&dyn Binding] = &[control, &self.weights, input, output];
                calls.push(kernels.run("thin", source, &constants, self.per_point(), bindings)?);
                continue;
            }
            let constants = constants.count("ROW", layer.0).flag("BIASED", true).flag("RELU", !is_last);
            let bindings: &[&dyn Binding] = &[control, &self.weights, input, output];
            calls.push(self.layer(kernels, "layer", &constants, layer.1, bindings)?);
        }
        Ok(calls)
    }

    /// Returns the calls for the gradients by the hidden layers and the inputs: those of one distance, if `ones`.
    pub(in super::super) fn back_to_inputs(
        &self,
        kernels: &mut Kernels,
        shared: &Shared,
        ones: bool,
    ) -> Result<Vec<Call>, DeviceError> {
        let Shared { control, .. } = *shared;
        let t = self.training();
        let mut calls = Vec::new();
        let layers = self.layers();
        for (l, &(n_in, n_out, at)) in layers.iter().enumerate().rev() {
            let is_last = l + 1 == layers.len();
            let d_output = if is_last { &t.d_out } else { &t.d_hidden[l] };
            if is_last && n_out <= THIN && l > 0 {
                let constants = self.layer_constants(shared, (n_in, n_out, at)).flag("ONES", ones);
                let source = include_str!("../shaders/thin_back.wgsl");
                let mut bindings: Vec<&dyn Binding> =
                    vec![control, &self.weights, &self.hidden[l - 1], &t.d_hidden[l - 1]];
                if !ones {
                    bindings.push(d_output);
                }
                calls.push(kernels.run("thin_back", source, &constants, self.per_point(), &bindings)?);
                continue;
            }
            // The outputs of this layer are the inputs of the way back.
            let constants = self.layer_constants(shared, (n_out, n_in, at)).count("ROW", n_in);
            let constants = constants.flag("TRANSPOSED", true).flag("MASKED", l > 0);
            let d_input = if l == 0 { &t.d_x } else { &t.d_hidden[l - 1] };
            let mut bindings: Vec<&dyn Binding> = vec![control, &self.weights, d_output, d_input];
            if l > 0 {
                bindings.push(&self.hidden[l - 1]);
            }
            calls.push(self.layer(kernels, "layer_back", &constants, n_in, &bindings)?);
        }
        Ok(calls)
    }

    /// Returns the calls that turn the inputs and hidden layers into what the gradients of the weights are made of (see
    /// [`crate::mlp::gradient`]): the inputs have become s x + J u already; a hidden layer becomes s h + t, with t its
    /// change along J u.
    pub(in super::super) fn tangents(
        &self,
        kernels: &mut Kernels,
        shared: &Shared,
        s: &Buffer,
    ) -> Result<Vec<Call>, DeviceError> {
        let layers = self.layers();
        let hidden = layers[..layers.len() - 1].iter().enumerate();
        hidden
            .map(|(l, &layer)| {
                let input = if l == 0 { &self.x } else { &self.hidden[l - 1] };
                let constants = self.layer_constants(shared, layer).count("ROW", layer.0);
                let constants = constants.flag("SCALED", true).flag("MASKED_BY_ITSELF", true);
                let bindings: &[&dyn Binding] = &[shared.control, &self.weights, input, &self.hidden[l], s];
                self.layer(kernels, "tangents", &constants, layer.1, bindings)
            })
            .collect()
    }
}
