// A layer of few outputs: one thread per point.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
@group(0) @binding(2) var<storage, read> a: array<f32>;
@group(0) @binding(3) var<storage, read_write> result: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    if (s >= control[N_AT]) { return; }
    for (var j = 0u; j < N_OUT; j++) {
        var v = weights[WEIGHTS_AT + N_IN * N_OUT + j];
        for (var i = 0u; i < N_IN; i++) { v += weights[WEIGHTS_AT + j * N_IN + i] * a[i * CAPACITY + s]; }
#if SIGMOID
        v = 1.0 / (1.0 + exp(-v));
#endif
        result[j * CAPACITY + s] = v;
    }
}
