// Sums the chunks' gradients, in order: one thread per parameter of the network.

@group(0) @binding(0) var<storage, read> partial: array<f32>;
@group(0) @binding(1) var<storage, read_write> gradient: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= N_PARAMS) { return; }
    var sum = 0.0;
    for (var c = 0u; c < N_CHUNKS; c++) { sum += partial[c * N_PARAMS + id.x]; }
    gradient[id.x] = sum;
}
