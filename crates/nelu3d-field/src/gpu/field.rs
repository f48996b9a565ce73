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
