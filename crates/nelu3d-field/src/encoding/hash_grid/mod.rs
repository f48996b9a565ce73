//! Multiresolution hash grid (Müller et al. 2022, Sec. 3), with a resolution of its own per axis.
//!
//! Level l is a grid of `resolution[a]` cells along axis a, whose vertices carry `n_features_per_level` learned values.
//! A point's features are the d-linear interpolation of its cell's corners, levels concatenated. A level whose vertices
//! fit into 2^`log2_hashmap_size` entries is indexed densely, others through the spatial hash of the paper's Eq. 4.
//!
//! Deviations from the paper: cells per axis differ (a sweep of a few dozen board positions supports far fewer along
//! depth than across the image), resolutions are rounded instead of floored so the finest is met exactly, and vertex v
//! of axis a lies at v / resolution\[a\], so that both ends of the unit interval are vertices. And what is hashed is
//! not a vertex but a *brick* of 2^D neighboring vertices, stored together: in 3-D with two features a brick is one
//! cache line, and the corners of a cell lie in (3/2)^3 = 3.4 bricks on average, where hashed vertices take four to
//! eight lines and neighbors along a ray share none of them.
//!
//! Points outside [0, 1]^D are clamped to it (NaN to 0); derivatives along a clamped axis are zero.

pub mod cpu;
pub mod reference;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// Multipliers of the spatial hash, Eq. 4.
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// Shape of a [`HashGrid`]. `D` is 2 or 3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashGridConfig<const D: usize> {
    /// Number of levels, L.
    pub n_levels: usize,
    /// Features per level, F: 1, 2, 4 or 8.
    pub n_features_per_level: usize,
    /// log2 of the largest number of entries of a level.
    pub log2_hashmap_size: u32,
    /// Cells per axis at the coarsest level.
    #[serde(with = "axes")]
    pub base_resolution: [u32; D],
    /// Cells per axis at the finest level; an axis where it equals the base stays constant.
    #[serde(with = "axes")]
    pub finest_resolution: [u32; D],
}

/// A [`HashGridConfig`] that makes no sense.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum HashGridError {
    /// D is neither 2 nor 3.
    #[error("a hash grid has 2 or 3 axes, not {0}")]
    Axes(usize),
    /// Too few or too many levels.
    #[error("n_levels must be in 1..=32, not {0}")]
    Levels(usize),
    /// F has no kernel.
    #[error("n_features_per_level must be 1, 2, 4 or 8, not {0}")]
    Features(usize),
    /// Table size out of range.
    #[error("log2_hashmap_size must be in 4..=26, not {0}")]
    TableSize(u32),
    /// Resolutions out of range or in the wrong order.
    #[error(
        "axis {axis}: resolutions must satisfy 1 <= base_resolution ({base}) <= finest_resolution ({finest}) <= 65536"
    )]
    Resolution {
        /// Index of the axis.
        axis: usize,
        /// Given base resolution.
        base: u32,
        /// Given finest resolution.
        finest: u32,
    },
}

/// One level of a [`HashGrid`].
#[derive(Clone, Debug, PartialEq)]
pub struct Level<const D: usize> {
    /// Cells per axis; vertices are one more.
    pub resolution: [u32; D],
    /// First entry of this level in the table.
    pub offset: usize,
    /// Number of entries of this level, a multiple of 16: whole cache lines, whatever the number of features.
    pub n_entries: usize,
    /// Whether bricks are indexed densely (else hashed).
    pub dense: bool,
}

/// Bricks of two vertices along an axis of `resolution` cells.
fn n_bricks(resolution: u32) -> u32 {
    (resolution + 2) / 2
}

impl<const D: usize> Level<D> {
    /// Returns the factor of a brick's coordinate along each axis: strides where dense, primes where hashed.
    pub(crate) fn factors(&self) -> [u32; 3] {
        if !self.dense {
            return PRIMES;
        }
        let mut factors = [1; 3];
        for a in 1..D {
            factors[a] = factors[a - 1] * n_bricks(self.resolution[a - 1]);
        }
        factors
    }

    /// Returns the entry of a vertex within this level.
    pub fn index(&self, vertex: [u32; D]) -> usize {
        let (mut brick, mut corner) = (0u32, 0);
        for (a, factor) in self.factors().into_iter().enumerate().take(D) {
            let along = (vertex[a] / 2).wrapping_mul(factor);
            brick = if self.dense { brick + along } else { brick ^ along };
            corner |= (vertex[a] % 2) << a;
        }
        if !self.dense {
            brick &= (self.n_entries >> D) as u32 - 1;
        }
        ((brick << D) | corner) as usize
    }
}

/// A hash grid's layout. Its parameters live with the caller: `table[entry][feature]`, levels one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct HashGrid<const D: usize> {
    config: HashGridConfig<D>,
    levels: Vec<Level<D>>,
}

impl<const D: usize> HashGrid<D> {
    /// Lays the levels out.
    ///
    /// # Errors
    /// A [`HashGridError`] for a configuration out of range.
    pub fn new(config: &HashGridConfig<D>) -> Result<Self, HashGridError> {
        if !matches!(D, 2 | 3) {
            return Err(HashGridError::Axes(D));
        }
        if !(1..=32).contains(&config.n_levels) {
            return Err(HashGridError::Levels(config.n_levels));
        }
        if !matches!(config.n_features_per_level, 1 | 2 | 4 | 8) {
            return Err(HashGridError::Features(config.n_features_per_level));
        }
        if !(4..=26).contains(&config.log2_hashmap_size) {
            return Err(HashGridError::TableSize(config.log2_hashmap_size));
        }
        for (axis, (&base, &finest)) in config.base_resolution.iter().zip(&config.finest_resolution).enumerate() {
            if !(1 <= base && base <= finest && finest <= 65536) {
                return Err(HashGridError::Resolution { axis, base, finest });
            }
        }
        let table_size = 1usize << config.log2_hashmap_size;
        let mut levels = Vec::with_capacity(config.n_levels);
        let mut offset = 0;
        for l in 0..config.n_levels {
            let exponent = if config.n_levels == 1 { 0.0 } else { l as f64 / (config.n_levels - 1) as f64 };
            let resolution: [u32; D] = std::array::from_fn(|a| {
                let (base, finest) = (config.base_resolution[a] as f64, config.finest_resolution[a] as f64);
                (base * (finest / base).powf(exponent)).round() as u32
            });
            let n_dense = (resolution.iter().map(|&n| n_bricks(n) as u128).product::<u128>() << D).next_multiple_of(16);
            let dense = n_dense <= table_size as u128;
            let n_entries = if dense { n_dense as usize } else { table_size };
            levels.push(Level { resolution, offset, n_entries, dense });
            offset += n_entries;
        }
        Ok(Self { config: config.clone(), levels })
    }

    /// Returns the configuration.
    pub fn config(&self) -> &HashGridConfig<D> {
        &self.config
    }

    /// Returns the levels, coarse to fine.
    pub fn levels(&self) -> &[Level<D>] {
        &self.levels
    }

    /// Returns the length of a feature vector, L · F.
    pub fn n_features(&self) -> usize {
        self.config.n_levels * self.config.n_features_per_level
    }

    /// Returns the number of entries over all levels.
    pub fn n_entries(&self) -> usize {
        self.levels.last().map_or(0, |l| l.offset + l.n_entries)
    }

    /// Returns the length of the table, in values.
    pub fn n_params(&self) -> usize {
        self.n_entries() * self.config.n_features_per_level
    }

    /// Fills a table with uniform values in ±1e-4 (Sec. 4).
    pub fn init(&self, seed: u64, table: &mut [f32]) {
        assert_eq!(table.len(), self.n_params());
        let mut rng = StdRng::seed_from_u64(seed);
        for x in table {
            *x = rng.random_range(-1e-4..1e-4);
        }
    }
}

/// `[u32; D]` as a list; serde derives arrays only for fixed lengths.
mod axes {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer, const D: usize>(axes: &[u32; D], s: S) -> Result<S::Ok, S::Error> {
        axes.as_slice().serialize(s)
    }

    pub(super) fn deserialize<'de, T: Deserializer<'de>, const D: usize>(d: T) -> Result<[u32; D], T::Error> {
        let values = Vec::<u32>::deserialize(d)?;
        let n = values.len();
        values.try_into().map_err(|_| T::Error::custom(format!("expected {D} axes, found {n}")))
    }
}
