// The distance's gradient in space at every sample: one thread per sample.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> table: array<f32>;
@group(0) @binding(3) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> d_x: array<f32>;
@group(0) @binding(5) var<storage, read_write> gradients: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    if (s >= control[N_AT]) { return; }
    let p = points[s].xyz;
    var g = vec3(0.0);
    for (var l = 0u; l < N_LEVELS; l++) {
        let level = levels[l];
        let cell = locate(level, p);
        for (var corner = 0u; corner < (1u << DIM); corner++) {
            let at = entry(level, cell, corner);
            var value = 0.0;
            for (var f = 0u; f < FEATURES; f++) { value += table[at + f] * d_x[(l * FEATURES + f) * CAPACITY + s]; }
            g += value * slope(level, cell, corner, p);
        }
    }
    for (var a = 0u; a < APPENDED; a++) { g[a] += 2.0 * d_x[(N_FEATURES + a) * CAPACITY + s]; }
    gradients[s] = vec4(g / vec3(EXTENT_X, EXTENT_Y, EXTENT_Z), 0.0);
}
