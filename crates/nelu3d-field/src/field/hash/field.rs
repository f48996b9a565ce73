//! A hash grid and a network.

use super::super::config::{FieldError, check_params};
use super::super::training::Training;
use super::config::HashFieldConfig;
use crate::encoding::hash_grid::{HashGrid, Level};
use crate::memory;
use crate::mlp::MlpConfig;
use crate::mlp::cpu::PackedMlp;

/// A learned function [0, 1]^D → R^k: a hash grid and a network.
///
/// ```
/// use nelu3d_field::{HashField, HashFieldConfig};
/// let config = HashFieldConfig::<2>::small(1);
/// let mut field = HashField::new(config, 7)?;
/// let points = [[0.1, 0.2], [0.7, 0.4]];
/// for _ in 0..200 {
///     field.train_step(&points, &[1.0, -1.0], &[]);
/// }
/// let mut out = [0.0; 2];
/// field.query(&points, &mut out);
/// assert!((out[0] - 1.0).abs() < 0.1 && (out[1] + 1.0).abs() < 0.1);
/// # Ok::<(), nelu3d_field::field::FieldError>(())
/// ```
#[derive(Clone, Debug)]
pub struct HashField<const D: usize = 3> {
    pub(crate) config: HashFieldConfig<D>,
    pub(crate) grid: HashGrid<D>,
    pub(crate) mlp: MlpConfig,
    /// The table, then the network.
    pub(crate) params: Vec<f32>,
    pub(crate) packed: PackedMlp,
    pub(crate) training: Option<Box<Training>>,
}

impl<const D: usize> HashField<D> {
    /// Makes a field with random parameters.
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range.
    pub fn new(config: HashFieldConfig<D>, seed: u64) -> Result<Self, FieldError> {
        let (grid, mlp) = config.build()?;
        let mut params = memory::zeros(grid.n_params() + mlp.n_params());
        let (table, network) = params.split_at_mut(grid.n_params());
        grid.init(seed, table);
        mlp.init(seed.wrapping_add(1), network);
        Self::from_params(config, params)
    }

    /// Makes a field with given parameters, in the order of [`HashField::params`].
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range, parameters of another length, or one that is not finite.
    pub fn from_params(config: HashFieldConfig<D>, params: Vec<f32>) -> Result<Self, FieldError> {
        let (grid, mlp) = config.build()?;
        check_params(&params, grid.n_params() + mlp.n_params())?;
        let packed = PackedMlp::new(&mlp, &params[grid.n_params()..]);
        Ok(Self { config, grid, mlp, params, packed, training: None })
    }

    /// Returns the configuration.
    pub fn config(&self) -> &HashFieldConfig<D> {
        &self.config
    }

    /// Returns all parameters: the hash table `[entry][feature]`, coarse to fine, then the network (see
    /// [`crate::mlp`]).
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// Returns the number of the hash table's parameters, the first of all, level by level.
    pub fn n_table_params(&self) -> usize {
        self.grid.n_params()
    }

    /// Returns the levels of the hash grid, coarse to fine.
    pub fn levels(&self) -> &[Level<D>] {
        self.grid.levels()
    }

    /// Returns the number of the network's parameters, the last of all.
    pub fn n_network_params(&self) -> usize {
        self.mlp.n_params()
    }

    /// Returns the length of an output vector, k.
    pub fn n_outputs(&self) -> usize {
        self.mlp.n_outputs
    }

    /// Returns the floating-point operations of the network for one point, forward: two per weight.
    pub fn flops_per_query(&self) -> usize {
        self.mlp.layers().map(|(n_in, n_out)| 2 * n_in * n_out).sum()
    }
}
