//! Times of calls, and the ceilings of a device.

use super::Gpu;
use super::program::{Binding, Call, Constants, FOLD, Kernels, folded};
use crate::device::DeviceError;
use std::sync::Arc;
use std::time::Instant;

/// What a phase of a step asks of the device.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Demand {
    /// Floating-point operations.
    pub(super) flops: f64,
    /// Bytes to and from memory.
    pub(super) bytes: f64,
}

/// Fused multiply-adds, as many as the device can do.
const FMA: &str = "
@group(0) @binding(0) var<storage, read_write> x: array<vec4<f32>>;
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let i = (wid.y * FOLD + wid.x) * 256u + lid.x;
    let y = x[i];
    var a = y;
    var b = y + 1.0;
    var c = y + 2.0;
    var d = y + 3.0;
    for (var k = 0u; k < ROUNDS; k++) {
        a = fma(a, y, y);
        b = fma(b, y, y);
        c = fma(c, y, y);
        d = fma(d, y, y);
    }
    x[i] = a + b + c + d;
}";

/// Reads and writes memory in order.
const STREAM: &str = "
@group(0) @binding(0) var<storage, read_write> x: array<vec4<f32>>;
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let i = (wid.y * FOLD + wid.x) * 256u + lid.x;
    if (i < N) { x[i] = x[i] * 0.5; }
}";

/// Returns the seconds of calls, run again and again for about `budget` seconds: the best of three such runs.
pub(super) fn seconds(gpu: &Gpu, calls: &[&[Call]], budget: f64) -> Result<f64, DeviceError> {
    let run = |n: usize| -> Result<f64, DeviceError> {
        let start = Instant::now();
        for _ in 0..n {
            gpu.submit(calls)?;
        }
        gpu.wait()?;
        Ok(start.elapsed().as_secs_f64() / n as f64)
    };
    let once = run(1)?.max(1e-7);
    let n = (budget / 3.0 / once).clamp(1.0, 1000.0) as usize;
    (0..3).try_fold(f64::INFINITY, |best, _| Ok(best.min(run(n)?)))
}

/// Returns the device's ceilings: floating-point operations and bytes per second.
pub(super) fn ceilings(gpu: &Arc<Gpu>, budget: f64) -> Result<[f64; 2], DeviceError> {
    const ROUNDS: usize = 256;
    let mut kernels = Kernels::new(gpu);
    let n_threads = if gpu.tiles { 1 << 20 } else { 1 << 12 };
    let x = gpu.upload("ceilings", &vec![[0.5f32; 4]; n_threads])?;
    let bindings: &[&dyn Binding] = &[&x];
    let constants = Constants::default().count("FOLD", FOLD).count("ROUNDS", ROUNDS);
    let call = kernels.run("fma", FMA, &constants, folded(n_threads, 256), bindings)?;
    let flops = (n_threads * ROUNDS * 4 * 4 * 2) as f64 / seconds(gpu, &[&[call]], budget)?;
    let n = (gpu.max_buffer_bytes.min(1 << 30) / 16) as usize;
    let x = gpu.zeros::<[f32; 4]>("ceilings", n)?;
    let bindings: &[&dyn Binding] = &[&x];
    let constants = Constants::default().count("FOLD", FOLD).count("N", n);
    let call = kernels.run("stream", STREAM, &constants, folded(n, 256), bindings)?;
    let bytes = (n * 32) as f64 / seconds(gpu, &[&[call]], budget)?;
    Ok([flops, bytes])
}
