//! Points per second of a color field's training step and query on this machine.
//!
//! `cargo run --release -p nelu3d-field --example throughput [steps]`; `RAYON_NUM_THREADS` sets the threads.

use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::mlp::{Activation, MlpConfig, cpu as mlp};
use nelu3d_field::{HashField, HashFieldConfig};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::time::Instant;

const N_POINTS: usize = 16384;

fn main() -> Result<(), nelu3d_field::field::FieldError> {
    let n_steps: usize = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(200);
    let mut config = HashFieldConfig::<3>::small(3);
    config.encoding = HashGridConfig {
        n_levels: 8,
        n_features_per_level: 2,
        log2_hashmap_size: 19,
        base_resolution: [32, 24, 24],
        finest_resolution: [768, 576, 24],
    };
    config.width = 64;
    let mut field = HashField::new(config, 1)?;
    let threads = rayon::current_num_threads();
    println!("{}, {} parameters, {threads} threads", field.config(), field.params().len());

    let random = batches(1);
    let weights = vec![1.0; N_POINTS];
    let mut out = vec![0.0; 3 * N_POINTS];
    // Neighbors along an image row, 1/640 apart, share cache lines of the table.
    for group in [1, 4, 8, 16] {
        let batches = batches(group);
        let mut step = |i: usize| {
            let (points, targets) = &batches[i % batches.len()];
            field.train_step(points, targets, &weights)
        };
        for i in 0..10 {
            step(i);
        }
        let timer = Timer::start();
        let loss = (0..n_steps).map(&mut step).last();
        let flops = 3 * field.flops_per_query();
        timer.report(&format!("train_step, groups of {group}"), n_steps * N_POINTS, flops);
        println!("  loss {loss:?}");
    }

    let timer = Timer::start();
    for i in 0..n_steps {
        field.query(&random[i % random.len()].0, &mut out);
    }
    timer.report("query, random points", n_steps * N_POINTS, field.flops_per_query());

    let rays: Vec<[f32; 3]> = (0..N_POINTS)
        .map(|i| [(i / 64 % 16) as f32 / 768.0, (i / 1024) as f32 / 576.0, (i % 64) as f32 / 64.0])
        .collect();
    let timer = Timer::start();
    for _ in 0..n_steps {
        field.query(&rays, &mut out);
    }
    timer.report("query, 256 rays", n_steps * N_POINTS, field.flops_per_query());

    let mut jacobian = vec![[0.0; 3]; 3 * N_POINTS];
    let timer = Timer::start();
    for _ in 0..n_steps / 4 {
        field.query_with_jacobian(&rays, &mut out, &mut jacobian);
    }
    timer.report("query_with_jacobian", n_steps / 4 * N_POINTS, 4 * field.flops_per_query());

    // The network alone, on one thread: how far from the machine's peak its products are.
    let shape =
        MlpConfig { n_inputs: 16, n_outputs: 3, width: 64, n_hidden_layers: 2, output_activation: Activation::Linear };
    let mut params = vec![0.0; shape.n_params()];
    shape.init(1, &mut params);
    let packed = mlp::PackedMlp::new(&shape, &params);
    let x = vec![0.5; N_POINTS * 16];
    let timer = Timer::start();
    for _ in 0..n_steps {
        mlp::forward(&packed, &x, &mut out);
    }
    timer.report("network forward", n_steps * N_POINTS, field.flops_per_query());
    let mut gradient = mlp::MlpGradient::new(&packed);
    let mut d_x = x.clone();
    let timer = Timer::start();
    for _ in 0..n_steps {
        mlp::backward(&packed, &x, &out, &mut gradient, &mut d_x);
    }
    timer.report("network forward + backward", n_steps * N_POINTS, 3 * field.flops_per_query());
    Ok(())
}

/// Points and targets of eight steps; points come in groups that are neighbors along x.
fn batches(group: usize) -> Vec<(Vec<[f32; 3]>, Vec<f32>)> {
    let mut rng = StdRng::seed_from_u64(2);
    let mut batch = || {
        let mut points: Vec<[f32; 3]> = Vec::with_capacity(N_POINTS);
        while points.len() < N_POINTS {
            let [x, y, z]: [f32; 3] = std::array::from_fn(|_| rng.random());
            points.extend((0..group).map(|i| [(x + i as f32 / 640.0).fract(), y, z]));
        }
        let targets = points.iter().flat_map(|&[x, y, z]| [x * y, (20.0 * x).sin(), z * z]).collect();
        (points, targets)
    };
    (0..8).map(|_| batch()).collect()
}

/// Wall and, on Linux, CPU time: the second is what counts on a busy machine.
struct Timer(Instant, Option<f64>);

impl Timer {
    fn start() -> Self {
        Self(Instant::now(), cpu_seconds())
    }

    fn report(self, what: &str, points: usize, flops: usize) {
        let m = points as f64 * 1e-6;
        let wall = m / self.0.elapsed().as_secs_f64();
        print!("{what}: {wall:.2} M points/s");
        if let (Some(start), Some(end)) = (self.1, cpu_seconds()) {
            let cpu = m / (end - start);
            print!(", {cpu:.2} M per CPU second, {:.1} GFLOP per CPU second in the network", cpu * flops as f64 * 1e-3);
        }
        println!();
    }
}

/// Seconds all threads of this process have run.
fn cpu_seconds() -> Option<f64> {
    let mut nanoseconds = 0;
    for task in std::fs::read_dir("/proc/self/task").ok()? {
        let stat = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        nanoseconds += stat.split_whitespace().next()?.parse::<u64>().ok()?;
    }
    Some(nanoseconds as f64 * 1e-9)
}
