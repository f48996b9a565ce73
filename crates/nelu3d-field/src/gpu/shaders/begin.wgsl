// Before a step: its rates, and how many rays it takes (sdf::next_ray_count).

@group(0) @binding(0) var<storage, read_write> control: array<u32>;
@group(0) @binding(1) var<storage, read> schedule: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> rates: array<f32>;

@compute @workgroup_size(1)
fn main() {
    let step = control[STEP_AT];
    // A row of each net per step.
    for (var i = 0u; i < 2u; i++) {
        let row = schedule[2u * step + i];
        rates[4u * i] = row.x;
        rates[4u * i + 1u] = row.y;
        rates[4u * i + 2u] = row.z;
        rates[4u * i + 3u] = row.w;
    }
    if (step > FIRST_STEP) {
        let n_rays = f32(control[RAYS_AT]);
        let n = control[N_AT_SAMPLES];
        var next = f32(MAX_RAYS);
        if (n > 0u) { next = floor(0.9 * n_rays + 0.1 * n_rays * f32(TARGET) / f32(n)); }
        control[RAYS_AT] = u32(clamp(next, 16.0, f32(MAX_RAYS)));
    }
    control[STEP_AT] = step + 1u;
    control[N_AT_SAMPLES] = 0u;
}
