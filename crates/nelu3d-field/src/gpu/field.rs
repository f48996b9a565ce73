//! Regression on the device: [`HashField::train_step`], many times, on data that stay there; and queries.

use super::Gpu;
use super::net::{Back, Net, Shared, schedule};
use super::program::{Binding, Kernels};
use crate::device::DeviceError;
use crate::field::{HashField, RegressionLoss};
use crate::mlp::Activation;
use std::sync::Arc;

/// Steps after which the device is waited for, so that it is never far behind and stops when asked.
const STEPS_AHEAD: usize = 16;
/// Points that a query works on together.
const QUERY_POINTS: usize = 1 << 17;

/// Where the numbers are that change from step to step.
const N_AT: usize = 0;
const STEP_AT: usize = 1;
const CURSOR_AT: usize = 2;

/// Samples of a function, in random order.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a, const D: usize> {
    /// In [0, 1]^D.
    pub points: &'a [[f32; D]],
    /// `[point][output]`
    pub targets: &'a [f32],
    /// Per point; empty for 1.
    pub weights: &'a [f32],
}

fn wide<const D: usize>(points: &[[f32; D]], weights: &[f32]) -> Vec<[f32; 4]> {
    let wide = |(i, p): (usize, &[f32; D])| {
        let mut out = [0.0; 4];
        out[..D].copy_from_slice(p);
        out[3] = weights.get(i).copied().unwrap_or(1.0);
        out
    };
    points.iter().enumerate().map(wide).collect()
}

impl<const D: usize> HashField<D> {
    /// Takes `n_steps` steps of weighted regression on the device, each on the next `batch` samples, round and round.
    /// `go_on` is told the number of steps submitted and can end the training. Returns the loss before the last step.
    ///
    /// # Errors
    ///
    /// The device failed; the field is as it was.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn train_on(
        &mut self,
        gpu: &Arc<Gpu>,
        samples: &Samples<'_, D>,
        batch: usize,
        n_steps: usize,
        mut go_on: impl FnMut(usize) -> bool,
    ) -> Result<f64, DeviceError> {
        let n_all = samples.points.len();
        let k = self.n_outputs();
        assert!(samples.targets.len() == n_all * k && (samples.weights.is_empty() || samples.weights.len() == n_all));
        if n_all == 0 || n_steps == 0 {
            return Ok(0.0);
        }
        let batch = batch.clamp(1, n_all);
        let first = self.n_steps();
        let net = Net::new(gpu, self, batch, true)?;
        let all_points = gpu.upload("samples", &wide(samples.points, samples.weights))?;
        let all_targets = gpu.upload("targets", samples.targets)?;
        let targets = gpu.zeros::<f32>("targets of a step", batch * k)?;
        let losses = gpu.zeros::<f32>("losses", batch)?;
        let control = gpu.upload("control", &[batch as u32, 0, (n_all - batch % n_all) as u32 % n_all as u32, 0])?;
        let rates = gpu.zeros::<f32>("rates", 4)?;
        let table = gpu.upload("schedule", &schedule(&self.config.training, first, n_steps))?;
        let shared = Shared { control: &control, n_at: N_AT, rates: &rates, rates_at: 0 };
        let mut kernels = Kernels::new(gpu);

        let delta = match self.config.training.loss {
            RegressionLoss::L2 => f64::from(f32::MAX),
            RegressionLoss::Huber { delta } => f64::from(delta.abs()),
        };
        let constants = net
            .constants(&shared)
            .count("N_OUT", k)
            .count("STEP_AT", STEP_AT)
            .count("CURSOR_AT", CURSOR_AT)
            .count("N_ALL", n_all)
            .value("DELTA", delta)
            .flag("SIGMOID", self.mlp.output_activation == Activation::Sigmoid);
        let per_point = [batch.div_ceil(64), 1, 1];
        let source = include_str!("shaders/next_window.wgsl");
        let mut calls = vec![kernels.run("next_window", source, &constants, [1; 3], &[&control, &table, &rates])?];
        let source = include_str!("shaders/window.wgsl");
        let bindings: &[&dyn Binding] = &[&control, &all_points, &all_targets, &net.points, &targets];
        calls.push(kernels.run("window", source, &constants, per_point, bindings)?);
        calls.extend(net.forward(&mut kernels, &shared)?);
        let source = include_str!("shaders/regress.wgsl");
        let bindings: &[&dyn Binding] = &[&control, &net.out, &targets, &net.points, net.d_out(), &losses];
        calls.push(kernels.run("regress", source, &constants, per_point, bindings)?);
        calls.extend(net.back_to_inputs(&mut kernels, &shared, false)?);
        calls.extend(net.descend(gpu, &mut kernels, &shared, Back::Outputs)?);

        let mut done = 0;
        while done < n_steps && go_on(done) {
            gpu.submit(&[&calls])?;
            done += 1;
            if done % STEPS_AHEAD == 0 {
                gpu.wait()?;
            }
        }
        let losses = gpu.read(&losses, batch)?;
        net.fetch(gpu, first + done as u64, self)?;
        Ok(losses.iter().map(|l| f64::from(*l)).sum())
    }

    /// Writes what [`HashField::query`] writes, on the device.
    ///
    /// # Errors
    ///
    /// The device failed.
    ///
    /// # Panics
    ///
    /// If `out` does not hold `n_outputs` values per point.
    pub fn query_on(&self, gpu: &Arc<Gpu>, points: &[[f32; D]], out: &mut [f32]) -> Result<(), DeviceError> {
        let k = self.n_outputs();
        assert_eq!(out.len(), points.len() * k);
        if points.is_empty() {
            return Ok(());
        }
        let net = Net::new(gpu, self, points.len().min(QUERY_POINTS), false)?;
        let control = gpu.zeros::<u32>("control", 4)?;
        let rates = gpu.zeros::<f32>("rates", 4)?;
        let shared = Shared { control: &control, n_at: N_AT, rates: &rates, rates_at: 0 };
        let calls = net.forward(&mut Kernels::new(gpu), &shared)?;
        for (points, out) in points.chunks(QUERY_POINTS).zip(out.chunks_mut(QUERY_POINTS * k)) {
            gpu.write(&net.points, &wide(points, &[]));
            gpu.write(&control, &[points.len() as u32]);
            gpu.submit(&[&calls])?;
            let values = gpu.read(&net.out, net.capacity * k)?;
            for (i, out) in out.chunks_exact_mut(k).enumerate() {
                for (j, out) in out.iter_mut().enumerate() {
                    *out = values[j * net.capacity + i];
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{test_gpu, test_gpu_alone};
    use super::*;
    use crate::check::{assert_close, uniform_f32};
    use crate::encoding::hash_grid::HashGridConfig;
    use crate::field::HashFieldConfig;

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

    fn outputs_agree<const D: usize>(k: usize, features: usize, width: usize, append: bool, n: usize) {
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

    fn step_agrees<const D: usize>(gpu: &Arc<Gpu>, config: HashFieldConfig<D>, n: usize) {
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
        let moments = |f: &HashField<D>| f.training.as_ref().unwrap().moments.clone();
        let (a, b) = (moments(&fast), moments(&slow));
        let norm = |v: &mut dyn Iterator<Item = f32>| v.map(|v| v * v).sum::<f32>().sqrt();
        let error = norm(&mut a.first.iter().zip(&b.first).map(|(a, b)| a - b)) / norm(&mut b.first.iter().copied());
        assert!(error < 2e-5, "gradients differ by {error}");
        assert_eq!((fast.n_steps(), slow.n_steps()), (1, 1));
        // Adam's first step is a sign: it tells where gradients are tiny. The others agree.
        let large = b.first.iter().fold(0.0f32, |m, v| m.max(v.abs())) * 1e-3;
        if !config.training.weight_normalization {
            for (i, m) in b.first.iter().enumerate().filter(|(_, m)| m.abs() > large) {
                assert!((fast.params[i] - slow.params[i]).abs() < 1e-5, "{i} {m}");
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
}
