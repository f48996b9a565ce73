//! A hash grid with its network and optimizer, on the device: what [`super::field`] and [`super::surface`] are made of.
//!
//! Values of points are stored `[row][point]`, `capacity` points to a row, so that neighboring threads read neighboring values.

use super::Gpu;
use super::program::{Binding, Buffer, Call, Constants, FOLD, Kernels, folded};
use crate::adam::{AdamConfig, MomentBuffers, Update};
use crate::device::DeviceError;
use crate::encoding::hash_grid::HashGrid;
use crate::field::training::Training;
use crate::field::{HashField, TrainConfig};
use crate::mlp::{Activation, MlpConfig, weight_norm};
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

const LEVEL: &str = include_str!("shaders/level.wgsl");
const ADAM: &str = include_str!("shaders/adam.wgsl");

/// Parts that the points are cut into where a network's gradient is summed.
const N_CHUNKS: usize = 128;
/// Outputs up to which a layer is worked on point by point.
const THIN: usize = 8;

/// Where a net finds what changes from step to step.
pub(super) struct Shared<'a> {
    /// Numbers of things.
    pub(super) control: &'a Buffer<u32>,
    /// Which of them is the number of points.
    pub(super) n_at: usize,
    /// Rates of the optimizers.
    pub(super) rates: &'a Buffer<f32>,
    /// Where this net's are: table, network, root.
    pub(super) rates_at: usize,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawLevel {
    resolution: [u32; 3],
    offset: u32,
    factors: [u32; 3],
    mask: u32,
}

/// What a gradient by the outputs is, on the way back.
pub(super) enum Back<'a> {
    /// [`Net::d_out`].
    Outputs,
    /// That of one signed distance by the network's inputs, f being 1: a gradient and not one of the loss. The loss has s by the distance and u by its
    /// gradient: see `surface/cpu.rs`.
    Distance {
        /// s, per point.
        s: &'a Buffer,
        /// u, per point, xyz and a fourth that is not read.
        u: &'a Buffer<[f32; 4]>,
    },
}

/// What a net costs.
pub(super) struct Work {
    /// Weights, and those of all layers but the last.
    pub(super) macs: f64,
    pub(super) inner_macs: f64,
    pub(super) n_inputs: f64,
    /// Values that the layers read and write.
    pub(super) unit_values: f64,
    /// Values of the table that a point is interpolated from.
    pub(super) corner_values: f64,
    pub(super) n_table: f64,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Net {
    mlp: MlpConfig,
    n_levels: usize,
    /// What every kernel of the net is completed by.
    constants: Constants,
    pub(super) capacity: usize,
    levels: Buffer<[u32; 8]>,
    pub(super) points: Buffer<[f32; 4]>,
    table: Buffer,
    weights: Buffer,
    /// Inputs, hidden layers, outputs.
    x: Buffer,
    hidden: Vec<Buffer>,
    pub(super) out: Buffer,
    /// What only training needs.
    training: Option<TrainingBuffers>,
}

#[derive(Debug)]
struct TrainingBuffers {
    settings: TrainConfig,
    n_raw: usize,
    d_table: Buffer,
    d_x: Buffer,
    d_hidden: Vec<Buffer>,
    d_out: Buffer,
    partial: Buffer,
    gradient: Buffer,
    raw: Buffer,
    units: Buffer<[u32; 4]>,
    table_moments: [Buffer; 2],
    network_moments: [Buffer; 2],
}

impl Net {
    /// A copy of a field on the device, for batches of up to `capacity` points; with its optimizer's state if it is to be trained.
    pub(super) fn new<const D: usize>(
        gpu: &Arc<Gpu>,
        field: &HashField<D>,
        capacity: usize,
        train: bool,
    ) -> Result<Self, DeviceError> {
        let capacity = capacity.next_multiple_of(64);
        let HashField { config, grid, mlp, params, .. } = field;
        let (table, weights) = params.split_at(grid.n_params());
        let append = if config.append_position { D } else { 0 };
        let constants = Constants::default()
            .count("DIM", D)
            .count("FEATURES", grid.config().n_features_per_level)
            .count("N_FEATURES", grid.n_features())
            .count("APPENDED", append)
            .count("CAPACITY", capacity)
            .count("FOLD", FOLD)
            .count("N_TABLE", table.len())
            .count("N_PARAMS", weights.len())
            .count("N_CHUNKS", N_CHUNKS);
        let hidden = |what: &str| -> Result<Vec<Buffer>, DeviceError> {
            (0..mlp.n_hidden_layers).map(|_| gpu.zeros(what, mlp.width * capacity)).collect()
        };
        let training = if train { Some(TrainingBuffers::new(gpu, field, capacity)?) } else { None };
        Ok(Self {
            mlp: mlp.clone(),
            n_levels: grid.levels().len(),
            constants,
            capacity,
            levels: gpu.upload("the encoding's levels", &levels(grid))?,
            points: gpu.zeros("points", capacity)?,
            table: gpu.upload("the hash table", table)?,
            weights: gpu.upload("the network", weights)?,
            x: gpu.zeros("network inputs", mlp.n_inputs * capacity)?,
            hidden: hidden("hidden layers")?,
            out: gpu.zeros("network outputs", mlp.n_outputs * capacity)?,
            training,
        })
    }

    fn training(&self) -> &TrainingBuffers {
        self.training.as_ref().expect("made to be trained")
    }

    /// Gradient by the sums of the output layer, to be written.
    pub(super) fn d_out(&self) -> &Buffer {
        &self.training().d_out
    }

    /// Gradient by the network's inputs.
    pub(super) fn d_x(&self) -> &Buffer {
        &self.training().d_x
    }

    /// What kernels that look at the net's values need to know.
    pub(super) fn constants(&self, shared: &Shared) -> Constants {
        self.constants.clone().count("N_AT", shared.n_at).count("RATES_AT", shared.rates_at)
    }

    /// (n_in, n_out) of every layer and where its weights begin.
    fn layers(&self) -> Vec<(usize, usize, usize)> {
        let mut at = 0;
        let place = |(n_in, n_out)| {
            let here = (n_in, n_out, at);
            at += (n_in + 1) * n_out;
            here
        };
        self.mlp.layers().map(place).collect()
    }

    fn layer_constants(&self, shared: &Shared, (n_in, n_out, at): (usize, usize, usize)) -> Constants {
        self.constants(shared).count("N_IN", n_in).count("N_OUT", n_out).count("WEIGHTS_AT", at)
    }

    fn per_point(&self) -> [usize; 3] {
        [self.capacity / 64, 1, 1]
    }

    /// A call of a layer: see the shaders.
    fn layer(
        &self,
        kernels: &mut Kernels,
        label: &'static str,
        constants: &Constants,
        n_out: usize,
        bindings: &[&dyn Binding],
    ) -> Result<Call, DeviceError> {
        let tiled = include_str!("shaders/layer.wgsl");
        let plain = include_str!("shaders/layer_plain.wgsl");
        let (form, per_group) = if kernels.gpu().tiles { (tiled, 64) } else { (plain, 4) };
        let source = [include_str!("shaders/layer_ends.wgsl"), form].concat();
        kernels.run(label, &source, constants, [self.capacity / 64, n_out.div_ceil(per_group), 1], bindings)
    }

    /// Points to outputs.
    pub(super) fn forward(&self, kernels: &mut Kernels, shared: &Shared) -> Result<Vec<Call>, DeviceError> {
        let Shared { control, .. } = *shared;
        let source = [LEVEL, include_str!("shaders/encode.wgsl")].concat();
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
                let source = include_str!("shaders/thin.wgsl");
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

    /// Gradients by the hidden layers and the inputs. From one distance, if `ones`.
    pub(super) fn back_to_inputs(
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
                let source = include_str!("shaders/thin_back.wgsl");
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

    /// Turns the inputs and hidden layers into what the gradients of the weights are made of (see `surface/cpu.rs`): the inputs have become
    /// s x + J u already; of a hidden layer it is s h + t, with t its change along J u.
    pub(super) fn tangents(
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

    /// Gradients of all parameters, and the step of the optimizer.
    pub(super) fn descend(
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
                (include_str!("shaders/gradient.wgsl"), [N_CHUNKS, n_out.div_ceil(64), n_in.div_ceil(64)])
            } else {
                (include_str!("shaders/gradient_plain.wgsl"), [N_CHUNKS, n_in.div_ceil(32), n_out.div_ceil(4)])
            };
            let source = [include_str!("shaders/gradient_ends.wgsl"), form].concat();
            calls.push(kernels.run("gradient", &source, &constants, groups, &bindings)?);
        }

        let source = [LEVEL, include_str!("shaders/scatter.wgsl")].concat();
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
        let source = [ADAM, include_str!("shaders/table.wgsl")].concat();
        let [first, second] = &t.table_moments;
        let bindings: &[&dyn Binding] = &[rates, &t.d_table, &self.table, first, second];
        calls.push(kernels.run("table", &source, &constants, folded(self.table.len(), 256), bindings)?);

        let n_params = self.weights.len();
        let groups = [n_params.div_ceil(64), 1, 1];
        let sum = include_str!("shaders/sum.wgsl");
        calls.push(kernels.run("sum", sum, &self.constants, groups, &[&t.partial, &t.gradient])?);
        let source = [ADAM, include_str!("shaders/network.wgsl")].concat();
        let constants = constants.count("N_UNITS", t.units.len()).flag("NORMALIZED", t.settings.weight_normalization);
        let [first, second] = &t.network_moments;
        let bindings: &[&dyn Binding] = &[rates, &t.units, &t.gradient, &self.weights, &t.raw, first, second];
        calls.push(kernels.run("network", &source, &constants, [t.units.len().div_ceil(64), 1, 1], bindings)?);
        Ok(calls)
    }

    /// What the net costs per point.
    pub(super) fn work(&self) -> Work {
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

    /// The encoding's slopes are looked at again by others.
    pub(super) fn encoding(&self) -> (&Buffer<[u32; 8]>, &Buffer, &Buffer, usize) {
        (&self.levels, &self.table, &self.x, self.n_levels)
    }

    /// Brings parameters and optimizer back into the field they came from.
    pub(super) fn fetch<const D: usize>(
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

impl TrainingBuffers {
    fn new<const D: usize>(gpu: &Arc<Gpu>, field: &HashField<D>, capacity: usize) -> Result<Self, DeviceError> {
        let HashField { config, grid, mlp, params, training, .. } = field;
        let settings = config.training.clone();
        let n_table = grid.n_params();
        let n_params = mlp.n_params();
        let mut state = training.as_deref().cloned().unwrap_or_default();
        state.prepare(&settings, mlp, params);
        let raw = if settings.weight_normalization { state.raw[0].clone() } else { params[n_table..].to_vec() };
        let n_raw = raw.len();
        debug_assert!(!settings.weight_normalization || n_raw == weight_norm::n_raw(mlp));
        let mut units = Vec::new();
        let mut at = 0;
        for (n_in, n_out) in mlp.layers() {
            units.extend((0..n_out).map(|j| [at + j * n_in, n_in, at + n_in * n_out + j, 0].map(|v| v as u32)));
            at += (n_in + 1) * n_out;
        }
        let moments = |values: &[f32]| -> Result<(Buffer, Buffer), DeviceError> {
            let (table, network) = values.split_at(n_table);
            Ok((gpu.upload("moments of the table", table)?, gpu.upload("moments of the network", network)?))
        };
        let (table_first, network_first) = moments(&state.moments.first)?;
        let (table_second, network_second) = moments(&state.moments.second)?;
        Ok(Self {
            n_raw,
            d_table: gpu.zeros("gradient of the table", n_table)?,
            d_x: gpu.zeros("gradients of network inputs", mlp.n_inputs * capacity)?,
            d_hidden: (0..mlp.n_hidden_layers)
                .map(|_| gpu.zeros("gradients of hidden layers", mlp.width * capacity))
                .collect::<Result<_, _>>()?,
            d_out: gpu.zeros("gradients of network outputs", mlp.n_outputs * capacity)?,
            partial: gpu.zeros("gradients of the network", N_CHUNKS * n_params)?,
            gradient: gpu.zeros("gradient of the network", n_params)?,
            raw: gpu.upload("raw parameters of the network", &raw)?,
            units: gpu.upload("units of the network", &units)?,
            table_moments: [table_first, table_second],
            network_moments: [network_first, network_second],
            settings,
        })
    }
}

/// The levels as kernels read them.
fn levels<const D: usize>(grid: &HashGrid<D>) -> Vec<[u32; 8]> {
    grid.levels()
        .iter()
        .map(|level| {
            // An axis that is not there has one cell and no say.
            let mut resolution = [1; 3];
            resolution[..D].copy_from_slice(&level.resolution);
            let mask = if level.dense { 0 } else { (level.n_entries >> D) as u32 - 1 };
            let factors = level.factors();
            bytemuck::cast(RawLevel { resolution, offset: level.offset as u32, factors, mask })
        })
        .collect()
}

/// Rates of a net in every step of its schedule from `first` on: table, network, root of the bias correction, and the schedule's factor.
pub(super) fn schedule(settings: &TrainConfig, first: u64, n_steps: usize) -> Vec<[f32; 4]> {
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
