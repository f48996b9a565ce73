// Occupancy: which cells are looked at again. All of them at first; later those that are occupied, and a quarter of the
// others.

@group(0) @binding(0) var<storage, read_write> control: array<atomic<u32>>;
@group(0) @binding(1) var<storage, read> cells: array<u32>;
@group(0) @binding(2) var<storage, read> occupied: array<u32>;
@group(0) @binding(3) var<storage, read_write> picked: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let i = (wid.y * FOLD + wid.x) * 256u + lid.x;
    if (i >= N_CELLS) { return; }
    let cell = cells[i];
    let step = atomicLoad(&control[STEP_AT]);
    let is_occupied = ((occupied[cell / 32u] >> (cell % 32u)) & 1u) == 1u;
    if (step < WARMUP || is_occupied || random(SEED, step, cell).x < 0.25) {
        picked[atomicAdd(&control[PICKED_AT], 1u)] = cell;
    }
}
