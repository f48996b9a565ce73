// Features of points: one thread per point and level. x[feature][point].

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> table: array<f32>;
@group(0) @binding(3) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    let l = id.y;
    if (s >= control[N_AT]) { return; }
    let p = points[s].xyz;
    let level = levels[l];
    let cell = locate(level, p);
    var sum: array<f32, FEATURES>;
    for (var f = 0u; f < FEATURES; f++) { sum[f] = 0.0; }
    for (var corner = 0u; corner < (1u << DIM); corner++) {
        let w = along(cell, corner);
        let weight = w.x * w.y * w.z;
        let at = entry(level, cell, corner);
        for (var f = 0u; f < FEATURES; f++) { sum[f] += weight * table[at + f]; }
    }
    for (var f = 0u; f < FEATURES; f++) { x[(l * FEATURES + f) * CAPACITY + s] = sum[f]; }
    if (l == 0u) {
        for (var a = 0u; a < APPENDED; a++) { x[(N_FEATURES + a) * CAPACITY + s] = 2.0 * p[a] - 1.0; }
    }
}
