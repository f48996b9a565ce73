//! Points per second of a color field's training step and query on this machine.
//!
//! `cargo run --release -p nelu3d-field --example throughput [steps]`; `RAYON_NUM_THREADS` sets the threads.

use nelu3d_field::encoding::hash_grid::HashGridConfig;
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

    let mut rng = StdRng::seed_from_u64(2);
    let batches: Vec<(Vec<[f32; 3]>, Vec<f32>)> = (0..8)
        .map(|_| {
            let points: Vec<[f32; 3]> = (0..N_POINTS).map(|_| std::array::from_fn(|_| rng.random())).collect();
            let targets = points.iter().flat_map(|&[x, y, z]| [x * y, (20.0 * x).sin(), z * z]).collect();
            (points, targets)
        })
        .collect();
    let weights = vec![1.0; N_POINTS];
    let mut step = |i: usize| {
        let (points, targets) = &batches[i % batches.len()];
        field.train_step(points, targets, &weights)
    };
    for i in 0..10 {
        step(i);
    }
    let start = Instant::now();
    let loss = (0..n_steps).map(&mut step).last();
    report("train_step", n_steps * N_POINTS, start.elapsed().as_secs_f64(), 3 * field.flops_per_query());
    println!("  loss {loss:?}");

    let mut out = vec![0.0; 3 * N_POINTS];
    let start = Instant::now();
    for i in 0..n_steps {
        field.query(&batches[i % batches.len()].0, &mut out);
    }
    report("query, random points", n_steps * N_POINTS, start.elapsed().as_secs_f64(), field.flops_per_query());

    let rays: Vec<[f32; 3]> = (0..N_POINTS)
        .map(|i| [(i / 64 % 16) as f32 / 768.0, (i / 1024) as f32 / 576.0, (i % 64) as f32 / 64.0])
        .collect();
    let start = Instant::now();
    for _ in 0..n_steps {
        field.query(&rays, &mut out);
    }
    report("query, 256 rays", n_steps * N_POINTS, start.elapsed().as_secs_f64(), field.flops_per_query());
    let mut jacobian = vec![[0.0; 3]; 3 * N_POINTS];
    let start = Instant::now();
    for _ in 0..n_steps / 4 {
        field.query_with_jacobian(&rays, &mut out, &mut jacobian);
    }
    report("query_with_jacobian", n_steps / 4 * N_POINTS, start.elapsed().as_secs_f64(), 4 * field.flops_per_query());
    Ok(())
}

fn report(what: &str, points: usize, seconds: f64, flops: usize) {
    let rate = points as f64 / seconds;
    println!("{what}: {:.2} M points/s, {:.1} GFLOP/s in the network", rate * 1e-6, rate * flops as f64 * 1e-9);
}
