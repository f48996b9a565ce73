//! The buffers of a net.

use super::super::adapter::Gpu;
use super::super::program::{Buffer, Constants, FOLD};
use super::shared::Shared;
use crate::device::DeviceError;
use crate::encoding::hash_grid::HashGrid;
use crate::field::{HashField, TrainConfig};
use crate::mlp::{MlpConfig, weight_norm};
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// Parts that the points are cut into where a network's gradient is summed.
pub(super) const N_CHUNKS: usize = 512;

/// A level as kernels read it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawLevel {
    resolution: [u32; 3],
    offset: u32,
    factors: [u32; 3],
    mask: u32,
}

/// A hash grid with its network, for batches of up to `capacity` points.
#[derive(Debug)]
pub(in super::super) struct Net {
    pub(super) mlp: MlpConfig,
    pub(super) n_levels: usize,
    /// The constants that complete every kernel of the net.
    pub(super) constants: Constants,
    pub(in super::super) capacity: usize,
    pub(super) levels: Buffer<[u32; 8]>,
    pub(in super::super) points: Buffer<[f32; 4]>,
    pub(super) table: Buffer,
    pub(super) weights: Buffer,
    /// Inputs, hidden layers, outputs.
    pub(super) x: Buffer,
    pub(super) hidden: Vec<Buffer>,
    pub(in super::super) out: Buffer,
    /// The buffers that only training needs.
    pub(super) training: Option<TrainingBuffers>,
}

/// The buffers that only training needs.
#[derive(Debug)]
pub(super) struct TrainingBuffers {
    pub(super) settings: TrainConfig,
    pub(super) n_raw: usize,
    pub(super) d_table: Buffer,
    pub(super) d_x: Buffer,
    pub(super) d_hidden: Vec<Buffer>,
    pub(super) d_out: Buffer,
    pub(super) partial: Buffer,
    pub(super) gradient: Buffer,
    pub(super) raw: Buffer,
    pub(super) units: Buffer<[u32; 4]>,
    pub(super) table_moments: [Buffer; 2],
    pub(super) network_moments: [Buffer; 2],
}

impl Net {
    /// Copies a field to the device, for batches of up to `capacity` points; with its optimizer's state if it is to
    /// be trained.
    pub(in super::super) fn new<const D: usize>(
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

    /// Returns the buffers of the training.
    pub(super) fn training(&self) -> &TrainingBuffers {
        self.training.as_ref().expect("made to be trained")
    }

    /// Returns the gradient by the sums of the output layer, to be written.
    pub(in super::super) fn d_out(&self) -> &Buffer {
        &self.training().d_out
    }

    /// Returns the gradient by the network's inputs.
    pub(in super::super) fn d_x(&self) -> &Buffer {
        &self.training().d_x
    }

    /// Returns the constants of kernels that read the net's values.
    pub(in super::super) fn constants(&self, shared: &Shared) -> Constants {
        self.constants.clone().count("N_AT", shared.n_at).count("RATES_AT", shared.rates_at)
    }

    /// Returns (n_in, n_out) of every layer and where its weights begin.
    pub(super) fn layers(&self) -> Vec<(usize, usize, usize)> {
        let mut at = 0;
        let place = |(n_in, n_out)| {
            let here = (n_in, n_out, at);
            at += (n_in + 1) * n_out;
            here
        };
        self.mlp.layers().map(place).collect()
    }

    /// Returns the constants of the kernels of one layer.
    pub(super) fn layer_constants(&self, shared: &Shared, (n_in, n_out, at): (usize, usize, usize)) -> Constants {
        self.constants(shared).count("N_IN", n_in).count("N_OUT", n_out).count("WEIGHTS_AT", at)
    }

    /// Returns the workgroups of a kernel with one thread per point.
    pub(super) fn per_point(&self) -> [usize; 3] {
        [self.capacity / 64, 1, 1]
    }

    /// Returns the levels, the table, the network's inputs and the number of levels.
    pub(in super::super) fn encoding(&self) -> (&Buffer<[u32; 8]>, &Buffer, &Buffer, usize) {
        (&self.levels, &self.table, &self.x, self.n_levels)
    }
}

impl TrainingBuffers {
    /// Makes the buffers that a field's training needs.
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

/// Returns the levels as kernels read them.
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
