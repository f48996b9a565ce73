//! Small neural fields and differentiable volume rendering on the CPU. Knows nothing about scanners.
//!
//! One folder per operation. Each has a contract (`mod.rs`), a plain `reference` generic over `f32`/`f64` that cites
//! its equations, and a fast `cpu` form that is tested against the reference:
//!
//! | operation | folder | source |
//! |---|---|---|
//! | multiresolution hash grid | [`encoding::hash_grid`] | Müller et al. 2022, *Instant NGP*, Sec. 3 |
//! | frequency encoding | [`encoding::frequency`] | Mildenhall et al. 2020, *NeRF*, Eq. 4 |
//! | multilayer perceptron | [`mlp`] | |
//! | compositing of signed distances | [`volrend`] | Wang et al. 2021, *NeuS*, Eq. 13 |
//! | losses | [`loss`] | NeLU3D, Eq. 2, 3, 5, 6 |
//! | weight normalization | [`mlp::weight_norm`] | Salimans & Kingma 2016, Eq. 2, 3 |
//! | occupancy grid | [`occupancy`] | Müller et al. 2022, Sec. 5.1 |
//! | nearest codewords of a table | [`nearest`] | |
//! | tricubic B-splines over a projective frame | [`lattice`] | |
//! | samples of such a spline in normal equations | [`normal`] | |
//! | depths of an image from a cost volume | [`cost_volume`] | Hirschmüller 2008, Sec. 2.3 |
//! | light gathered from diffuse patches | [`gathering`] | Wallace et al. 1989 |
//! | thin plate over pixels | [`plate`] | |
//! | optimizer | [`adam`] | Kingma & Ba 2015, Alg. 1 |
//!
//! Two things are made of them: [`field::HashField`], a regression (one flat parameter buffer, one training step, one
//! query), and [`surface::NeuralSurface`], a signed distance field trained by volume rendering.
//!
//! Results depend on the seed and the inputs only, never on the number of threads: work is cut into fixed blocks, and
//! sums are reduced in a fixed order.

pub mod adam;
pub mod bench;
pub mod cost_volume;
pub mod device;
pub mod encoding;
pub mod field;
pub mod gathering;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod lattice;
pub mod loss;
mod memory;
pub mod mlp;
pub mod nearest;
pub mod normal;
pub mod occupancy;
pub mod plate;
pub mod prefetch;
mod real;
mod reduce;
pub mod state;
pub mod surface;
pub mod volrend;

pub use field::{FrequencyField, FrequencyFieldConfig, HashField, HashFieldConfig};
pub use real::Real;
pub use surface::NeuralSurface;
