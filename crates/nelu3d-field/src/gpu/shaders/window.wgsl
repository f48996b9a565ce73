// The next points of a data set that was shuffled before: a window that goes round it.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> all_points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> all_targets: array<f32>;
@group(0) @binding(3) var<storage, read_write> points: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> targets: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    if (s >= control[N_AT]) { return; }
    let i = (control[CURSOR_AT] + s) % N_ALL;
    points[s] = all_points[i];
    for (var j = 0u; j < N_OUT; j++) { targets[s * N_OUT + j] = all_targets[i * N_OUT + j]; }
}
