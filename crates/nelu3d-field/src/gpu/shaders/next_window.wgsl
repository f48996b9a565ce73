// Before a step of the regression: its rates, and where its window begins.

@group(0) @binding(0) var<storage, read_write> control: array<u32>;
@group(0) @binding(1) var<storage, read> schedule: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> rates: array<f32>;

@compute @workgroup_size(1)
fn main() {
    let step = control[STEP_AT];
    let row = schedule[step];
    rates[0] = row.x;
    rates[1] = row.y;
    rates[2] = row.z;
    control[STEP_AT] = step + 1u;
    control[CURSOR_AT] = u32((control[CURSOR_AT] + control[N_AT]) % N_ALL);
}
