use crate::check::{assert_close, uniform_f32};
use crate::gpu::test_device::{test_gpu, test_gpu_alone};
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::field::{HashField, HashFieldConfig, RegressionLoss};
use nelu3d_field::gpu::{Gpu, Samples};
use nelu3d_field::mlp::Activation;
use std::sync::Arc;

/// A field on the CPU in any of its dimensions.
trait OnCpu<const D: usize> {
    fn query_points(&self, points: &[[f32; D]], out: &mut [f32]);
    fn regress(&mut self, points: &[[f32; D]], targets: &[f32], weights: &[f32]) -> f64;
}

macro_rules! on_cpu {
    ($($D:literal),*) => {$(
        impl OnCpu<$D> for HashField<$D> {
            fn query_points(&self, points: &[[f32; $D]], out: &mut [f32]) {
                self.query(points, out);
            }

            fn regress(&mut self, points: &[[f32; $D]], targets: &[f32], weights: &[f32]) -> f64 {
                self.train_step(points, targets, weights)
            }
        }
    )*};
}

on_cpu!(2, 3);

fn config<const D: usize>(k: usize, features: usize, width: usize, append: bool) -> HashFieldConfig<D> {
    let mut config = HashFieldConfig::small(k);
    config.encoding = HashGridConfig {
        n_levels: 5,
        n_features_per_level: features,
        log2_hashmap_size: 9,
        base_resolution: [3; D],
        finest_resolution: std::array::from_fn(|a| 20 + 7 * a as u32),
    };
    config.width = width;
    config.append_position = append;
    config
}

fn field<const D: usize>(config: HashFieldConfig<D>) -> HashField<D> {
    let n = HashField::new(config.clone(), 1).unwrap().params().len();
    HashField::from_params(config, uniform_f32(5, n, -0.4, 0.4)).unwrap()
}

fn points<const D: usize>(n: usize) -> Vec<[f32; D]> {
    // Some on the border, some outside.
    let values = uniform_f32(7, n * D, -0.05, 1.05);
    let mut points: Vec<[f32; D]> = values.chunks_exact(D).map(|p| p.try_into().unwrap()).collect();
    points[0] = [0.0; D];
    points[1] = [1.0; D];
    points
}

fn outputs_agree<const D: usize>(k: usize, features: usize, width: usize, append: bool, n: usize)
where
    HashField<D>: OnCpu<D>,
{
    let Some(gpu) = test_gpu() else { return };
    let mut config = config::<D>(k, features, width, append);
    config.output_activation = if k.is_multiple_of(2) { Activation::Sigmoid } else { Activation::Linear };
    let field = field(config);
    let points = points::<D>(n);
    let (mut a, mut b) = (vec![0.0; n * k], vec![0.0; n * k]);
    field.query_points(&points, &mut b);
    field.query_on(&gpu, &points, &mut a).unwrap();
    // Three layers of sums of up to 80 terms.
    assert_close(&a, &b, 3.0 * 80.0 * f32::EPSILON);
}

#[test]
fn queries_agree_with_the_cpu() {
    outputs_agree::<3>(1, 2, 32, false, 1000);
    outputs_agree::<3>(3, 4, 24, true, 65);
    outputs_agree::<2>(12, 1, 80, true, 300);
    outputs_agree::<2>(2, 8, 64, false, 2);
}

fn step_agrees<const D: usize>(gpu: &Arc<Gpu>, config: HashFieldConfig<D>, n: usize)
where
    HashField<D>: OnCpu<D>,
{
    let k = config.n_outputs;
    let start = field(config.clone());
    let points = points::<D>(n);
    let targets = uniform_f32(11, n * k, 0.0, 1.0);
    let weights = uniform_f32(12, n, 0.5, 1.5);
    let (mut slow, mut fast) = (start.clone(), start.clone());
    let expected = slow.regress(&points, &targets, &weights);
    let samples = Samples { points: &points, targets: &targets, weights: &weights };
    let loss = fast.train_on(gpu, &samples, n, 1, |_| true).unwrap();
    assert!((loss - expected).abs() < 1e-5 * expected.abs(), "{loss} {expected}");
    // After one step the first moment is the gradient, but for a factor.
    let moments = |f: &HashField<D>| f.moments().unwrap().clone();
    let (a, b) = (moments(&fast), moments(&slow));
    let norm = |v: &mut dyn Iterator<Item = f32>| v.map(|v| v * v).sum::<f32>().sqrt();
    let error = norm(&mut a.first.iter().zip(&b.first).map(|(a, b)| a - b)) / norm(&mut b.first.iter().copied());
    assert!(error < 2e-5, "gradients differ by {error}");
    assert_eq!((fast.n_steps(), slow.n_steps()), (1, 1));
    // Adam's first step is a sign: it tells where gradients are tiny. The others agree.
    let large = b.first.iter().fold(0.0f32, |m, v| m.max(v.abs())) * 1e-3;
    if !config.training.weight_normalization {
        for (i, m) in b.first.iter().enumerate().filter(|(_, m)| m.abs() > large) {
            assert!((fast.params()[i] - slow.params()[i]).abs() < 1e-5, "{i} {m}");
        }
    }
    // And what was trained is what is asked.
    let mut out = vec![0.0; n * k];
    fast.query_points(&points, &mut out);
    let again = HashField::from_params(config, fast.params().to_vec()).unwrap();
    let mut out_again = out.clone();
    again.query_points(&points, &mut out_again);
    assert_eq!(out, out_again);
}

#[test]
fn a_step_agrees_with_the_cpu() {
    for gpu in [test_gpu(), test_gpu_alone()].into_iter().flatten() {
        step_agrees(&gpu, config::<3>(1, 2, 32, false), 1000);
        step_agrees(&gpu, config::<2>(12, 4, 80, true), 333);
        let mut sigmoid = config::<3>(3, 2, 64, true);
        sigmoid.output_activation = Activation::Sigmoid;
        sigmoid.training.loss = RegressionLoss::Huber { delta: 0.2 };
        step_agrees(&gpu, sigmoid, 4000);
        let mut normalized = config::<3>(2, 1, 24, false);
        normalized.training.weight_normalization = true;
        normalized.n_hidden_layers = 1;
        step_agrees(&gpu, normalized, 97);
    }
}

#[test]
fn training_learns_what_the_cpu_learns_and_goes_on_there() {
    let Some(gpu) = test_gpu() else { return };
    let mut config = config::<2>(2, 2, 16, false);
    config.training.schedule.n_steps = 200;
    let truth = |p: &[f32; 2]| [(9.0 * p[0]).sin() * 0.4, (7.0 * p[1] + p[0]).cos() * 0.4];
    let unit: Vec<[f32; 2]> = uniform_f32(3, 8192, 0.0, 1.0).chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    let targets: Vec<f32> = unit.iter().flat_map(truth).collect();
    let samples = Samples { points: &unit, targets: &targets, weights: &[] };
    let rmse = |field: &HashField<2>| {
        let mut out = vec![0.0; targets.len()];
        field.query(&unit, &mut out);
        (out.iter().zip(&targets).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / out.len() as f32).sqrt()
    };
    let mut field = HashField::new(config, 3).unwrap();
    field.train_on(&gpu, &samples, 256, 100, |_| true).unwrap();
    let halfway = rmse(&field);
    // A lost device is no reason to begin again.
    for step in 0..100 {
        let at = step * 512 % 4096;
        field.train_step(&unit[at..at + 512], &targets[at * 2..(at + 512) * 2], &[]);
    }
    let end = rmse(&field);
    assert!(halfway < 0.08 && end < 0.05 && end < halfway, "{halfway} {end}");
    // It ends when told to.
    let before = field.n_steps();
    field.train_on(&gpu, &samples, 512, 100, |done| done < 7).unwrap();
    assert_eq!(field.n_steps(), before + 7);
}

#[test]
fn a_lost_device_leaves_the_field_as_it_was() {
    let Some(gpu) = test_gpu_alone() else { return };
    let mut field = field(config::<2>(1, 2, 16, false));
    let before = field.params().to_vec();
    let unit = points::<2>(100);
    let targets = vec![0.5; 100];
    let samples = Samples { points: &unit, targets: &targets, weights: &[] };
    let e = field.train_on(&gpu, &samples, 100, 1000, |done| {
        if done == 20 {
            gpu.destroy();
        }
        true
    });
    assert!(e.is_err() && field.params() == before && field.n_steps() == 0, "{e:?}");
}
