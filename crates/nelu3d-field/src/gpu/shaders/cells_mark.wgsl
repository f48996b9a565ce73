// Occupancy: cells above the threshold, 32 to a thread. Cells that do not exist stay at 0 and are none.

@group(0) @binding(0) var<storage, read> values: array<f32>;
@group(0) @binding(1) var<storage, read> threshold: array<f32>;
@group(0) @binding(2) var<storage, read_write> occupied: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= (CELLS * CELLS * CELLS + 31u) / 32u) { return; }
    var bits = 0u;
    for (var b = 0u; b < 32u; b++) {
        let cell = id.x * 32u + b;
        if (cell < CELLS * CELLS * CELLS && values[cell] > threshold[0]) { bits |= 1u << b; }
    }
    occupied[id.x] = bits;
}
