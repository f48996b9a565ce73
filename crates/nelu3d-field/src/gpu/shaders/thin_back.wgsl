// Back through a layer of few outputs, into the units of the hidden layer before it that were positive: one thread per
// point. ONES: the gradient by the outputs is 1.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
@group(0) @binding(2) var<storage, read> hidden: array<f32>;
@group(0) @binding(3) var<storage, read_write> d_hidden: array<f32>;
#if ONES
#else
@group(0) @binding(4) var<storage, read> d_out: array<f32>;
#endif

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    if (s >= control[N_AT]) { return; }
    for (var i = 0u; i < N_IN; i++) {
        var d = 0.0;
        if (hidden[i * CAPACITY + s] > 0.0) {
            for (var j = 0u; j < N_OUT; j++) {
#if ONES
                d += weights[WEIGHTS_AT + j * N_IN + i];
#else
                d += weights[WEIGHTS_AT + j * N_IN + i] * d_out[j * CAPACITY + s];
#endif
            }
        }
        d_hidden[i * CAPACITY + s] = d;
    }
}
