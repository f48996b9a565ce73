//! The shape of a signed distance field before its training.

use nelu3d_field::adam::Schedule;
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::field::TrainConfig;
use nelu3d_field::surface::{NeuralSurface, SurfaceConfig};
use nelu3d_field::{HashField, HashFieldConfig};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use super::bounds::SIDE;

/// The first shape of a signed distance field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// None, as TurboSL's public code has it: random parameters
    Random,
    /// A plane through the middle of the volume that faces the camera
    Plane,
    /// A sphere of half a unit in the middle of the volume
    #[default]
    Sphere,
}

impl Start {
    /// Returns the shape's distance as a function on the unit cube, units; positive on the camera's side. `None` if
    /// there is no shape.
    pub fn distance(self) -> Option<fn([f32; 3]) -> f32> {
        const UNIT: f32 = SIDE as f32;
        match self {
            Start::Random => None,
            Start::Plane => Some(|q| UNIT * (0.5 - q[2])),
            Start::Sphere => Some(|q| UNIT * q.iter().map(|q| (q - 0.5) * (q - 0.5)).sum::<f32>().sqrt() - 0.5),
        }
    }

    /// Makes a surface of this shape. A random one has the published parameters: entries uniform in ±1e-4, weights
    /// Kaiming-uniform, biases zero.
    pub fn surface(self, config: SurfaceConfig, seed: u64) -> NeuralSurface {
        match self.distance() {
            Some(distance) => fit(distance, config, seed),
            None => random(config, seed),
        }
    }
}

/// Makes a surface of random parameters.
fn random(config: SurfaceConfig, seed: u64) -> NeuralSurface {
    let mut params = HashField::new(config.field.clone(), seed).expect(VALID).params().to_vec();
    // The output layer, too, has the gain of ReLU: weights uniform in ±√(6/n), where ours has ±√(3/n).
    let n = params.len();
    params[n - 1 - config.field.width..n - 1].iter_mut().for_each(|w| *w *= 2f32.sqrt());
    NeuralSurface::from_params(config, params).expect(VALID)
}

/// What a configuration of the published kind is.
pub(super) const VALID: &str = "the published configuration is valid";

/// Trains a surface of a simple shape. The network alone learns it, beside a small hash table that contributes nearly
/// nothing; the real table begins as small, so that its fine levels add no wrinkles.
fn fit(distance: fn([f32; 3]) -> f32, config: SurfaceConfig, seed: u64) -> NeuralSurface {
    const STEPS: u64 = 1500;
    const POINTS: usize = 1024;
    let training = TrainConfig {
        encoding_learning_rate: 0.0,
        network_learning_rate: 1e-2,
        schedule: Schedule { n_steps: STEPS, final_factor: 0.01, ..Default::default() },
        weight_normalization: false,
        ..config.field.training.clone()
    };
    let encoding = HashGridConfig { log2_hashmap_size: 8, ..config.field.encoding.clone() };
    let settings = HashFieldConfig { encoding, training, ..config.field.clone() };
    let mut small = HashField::new(settings, seed).expect(VALID);
    let mut rng = StdRng::seed_from_u64(seed);
    for _ in 0..STEPS {
        let points: Vec<[f32; 3]> = (0..POINTS).map(|_| std::array::from_fn(|_| rng.random())).collect();
        let targets: Vec<f32> = points.iter().map(|&p| distance(p)).collect();
        small.train_step(&points, &targets, &[]);
    }
    let mut params = HashField::new(config.field.clone(), seed).expect(VALID).params().to_vec();
    let n_network = small.n_network_params();
    let n = params.len();
    params[n - n_network..].copy_from_slice(&small.params()[small.params().len() - n_network..]);
    NeuralSurface::from_params(config, params).expect(VALID)
}
