// Regression: gradient by the network's sums of (1 / n k) sum_i w_i sum_o rho(y - target), one thread per point.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> y: array<f32>;
@group(0) @binding(2) var<storage, read> targets: array<f32>;
@group(0) @binding(3) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> d_out: array<f32>;
@group(0) @binding(5) var<storage, read_write> losses: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    let n = control[N_AT];
    if (s >= n) { return; }
    let weight = points[s].w / f32(n * N_OUT);
    var sum = 0.0;
    for (var j = 0u; j < N_OUT; j++) {
        let v = y[j * CAPACITY + s];
        let r = v - targets[s * N_OUT + j];
        // Huber; DELTA is huge for plain squares.
        let clipped = clamp(r, -DELTA, DELTA);
        sum += clipped * (2.0 * r - clipped);
        var d = weight * 2.0 * clipped;
#if SIGMOID
        d *= v * (1.0 - v);
#endif
        d_out[j * CAPACITY + s] = d;
    }
    losses[s] = weight * sum;
}
