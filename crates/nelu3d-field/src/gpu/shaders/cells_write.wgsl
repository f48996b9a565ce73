// Occupancy: a cell's value is a decaying maximum of alpha, that of a surface seen head on over one step
// (sdf::update_occupancy).

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> picked: array<u32>;
@group(0) @binding(2) var<storage, read> sdf: array<f32>;
@group(0) @binding(3) var<storage, read> sharpness: array<f32>;
@group(0) @binding(4) var<storage, read_write> values: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= control[N_AT]) { return; }
    let cell = picked[control[BEGIN_AT] + id.x];
    let inv_s = sharpness[3];
    let before = 1.0 / (1.0 + exp(-inv_s * (sdf[id.x] + HALF_STEP)));
    let after = 1.0 / (1.0 + exp(-inv_s * (sdf[id.x] - HALF_STEP)));
    let alpha = clamp((before - after + 1e-5) / (before + 1e-5), 0.0, 1.0);
    values[cell] = max(values[cell] * DECAY, alpha);
}
