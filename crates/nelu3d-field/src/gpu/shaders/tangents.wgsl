// Turns the network's inputs x into s x + J u: one thread per sample and level.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> table: array<f32>;
@group(0) @binding(3) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> x: array<f32>;
@group(0) @binding(5) var<storage, read> s_of: array<f32>;
@group(0) @binding(6) var<storage, read> u_of: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    let l = id.y;
    if (s >= control[N_AT]) { return; }
    let p = points[s].xyz;
    let u = u_of[s].xyz;
    var sum: array<f32, FEATURES>;
    for (var f = 0u; f < FEATURES; f++) { sum[f] = s_of[s] * x[(l * FEATURES + f) * CAPACITY + s]; }
    if (any(u != vec3(0.0))) {
        let level = levels[l];
        let cell = locate(level, p);
        for (var corner = 0u; corner < (1u << DIM); corner++) {
            let at = entry(level, cell, corner);
            let along_u = dot(slope(level, cell, corner, p), u);
            for (var f = 0u; f < FEATURES; f++) { sum[f] += along_u * table[at + f]; }
        }
    }
    for (var f = 0u; f < FEATURES; f++) { x[(l * FEATURES + f) * CAPACITY + s] = sum[f]; }
    if (l == 0u) {
        for (var a = 0u; a < APPENDED; a++) { x[(N_FEATURES + a) * CAPACITY + s] = s_of[s] * (2.0 * p[a] - 1.0) + 2.0 * u[a]; }
    }
}
