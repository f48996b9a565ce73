// Gradient of the table: one thread per point and level. d_x[feature][point] is the gradient by the features, or, of a
// signed distance, that of the distance by them; then s is that of the loss by the distance and u by the distance's
// gradient, and the two roads through the table are walked at once.

#if F32_ATOMICS
@group(0) @binding(0) var<storage, read_write> d_table: array<atomic<f32>>;
fn add(i: u32, value: f32) { atomicAdd(&d_table[i], value); }
#else
@group(0) @binding(0) var<storage, read_write> d_table: array<atomic<u32>>;
fn add(i: u32, value: f32) {
    var old = atomicLoad(&d_table[i]);
    loop {
        let answer = atomicCompareExchangeWeak(&d_table[i], old, bitcast<u32>(bitcast<f32>(old) + value));
        if (answer.exchanged) { break; }
        old = answer.old_value;
    }
}
#endif
@group(0) @binding(1) var<storage, read> control: array<u32>;
@group(0) @binding(2) var<storage, read> levels: array<Level>;
@group(0) @binding(3) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> d_x: array<f32>;
#if TANGENTS
@group(0) @binding(5) var<storage, read> s_of: array<f32>;
@group(0) @binding(6) var<storage, read> u_of: array<vec4<f32>>;
#endif

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    let l = id.y;
    if (s >= control[N_AT]) { return; }
    let p = points[s].xyz;
    let level = levels[l];
    let cell = locate(level, p);
    var d: array<f32, FEATURES>;
    for (var f = 0u; f < FEATURES; f++) { d[f] = d_x[(l * FEATURES + f) * CAPACITY + s]; }
    for (var corner = 0u; corner < (1u << DIM); corner++) {
        let w = along(cell, corner);
        var weight = w.x * w.y * w.z;
#if TANGENTS
        weight = weight * s_of[s] + dot(slope(level, cell, corner, p), u_of[s].xyz);
#endif
        let at = entry(level, cell, corner);
        for (var f = 0u; f < FEATURES; f++) {
            let value = weight * d[f];
            if (value != 0.0) { add(at + f, value); }
        }
    }
}
