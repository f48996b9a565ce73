//! The shape a signed distance field has before it has seen anything.

use nelu3d_field::field::TrainConfig;
use nelu3d_field::surface::{NeuralSurface, SurfaceConfig};
use nelu3d_field::{HashField, HashFieldConfig};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use super::SIDE;

/// The first shape of a signed distance field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// A plane through the middle of the volume that faces the camera
    #[default]
    Plane,
    /// A sphere of half a unit in the middle of the volume
    Sphere,
}

impl Start {
    /// Its distance at a point of the unit cube, units; positive on the camera's side.
    fn distance(self, q: [f32; 3]) -> f32 {
        let p = q.map(|q| (q - 0.5) * SIDE as f32);
        match self {
            Start::Plane => -p[2],
            Start::Sphere => p.iter().map(|x| x * x).sum::<f32>().sqrt() - 0.5,
        }
    }

    /// A surface of this shape. Only the network learns it, so that the hash table's fine levels stay silent.
    pub fn surface(self, config: SurfaceConfig, seed: u64) -> NeuralSurface {
        const STEPS: u64 = 400;
        const POINTS: usize = 4096;
        let training = TrainConfig {
            encoding_learning_rate: 0.0,
            network_learning_rate: 3e-3,
            schedule: nelu3d_field::adam::Schedule { n_steps: STEPS, final_factor: 0.03, ..Default::default() },
            weight_normalization: false,
            ..config.field.training.clone()
        };
        let settings = HashFieldConfig { training, ..config.field.clone() };
        let mut field = HashField::new(settings, seed).expect("the published configuration is valid");
        let mut rng = StdRng::seed_from_u64(seed);
        for _ in 0..STEPS {
            let points: Vec<[f32; 3]> = (0..POINTS).map(|_| std::array::from_fn(|_| rng.random())).collect();
            let targets: Vec<f32> = points.iter().map(|&p| self.distance(p)).collect();
            field.train_step(&points, &targets, &[]);
        }
        NeuralSurface::from_params(config, field.params().to_vec()).expect("the published configuration is valid")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn has_the_shape_it_says() {
        for start in [Start::Plane, Start::Sphere] {
            let mut config = super::super::surface_config(Default::default(), 100);
            config.field.encoding.log2_hashmap_size = 12;
            let surface = start.surface(config, 3);
            let mut rng = StdRng::seed_from_u64(9);
            let points: Vec<[f32; 3]> = (0..2000).map(|_| std::array::from_fn(|_| rng.random())).collect();
            let mut found = vec![0.0; points.len()];
            surface.field().query(&points, &mut found);
            let rms = points.iter().zip(&found).map(|(&p, f)| (start.distance(p) - f).powi(2)).sum::<f32>();
            let rms = (rms / points.len() as f32).sqrt();
            assert!(rms < 0.02, "{start:?}: {rms}");
        }
    }
}
