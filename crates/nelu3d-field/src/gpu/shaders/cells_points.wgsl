// Occupancy: a random point of every cell of the batch.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> picked: array<u32>;
@group(0) @binding(2) var<storage, read_write> points: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= control[N_AT]) { return; }
    let cell = picked[control[BEGIN_AT] + id.x];
    let corner = vec3(cell % CELLS, cell / CELLS % CELLS, cell / CELLS / CELLS);
    let within = random(SEED + 1u, control[STEP_AT], cell);
    points[id.x] = vec4((vec3<f32>(corner) + within) / f32(CELLS), 1.0);
}
