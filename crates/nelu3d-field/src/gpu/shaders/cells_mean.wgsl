// Occupancy: the threshold, at most the mean over all cells that exist. One workgroup.

@group(0) @binding(0) var<storage, read> cells: array<u32>;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> threshold: array<f32>;

var<workgroup> sums: array<f32, 256>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_id) lid: vec3<u32>) {
    let t = lid.x;
    var sum = 0.0;
    for (var i = t; i < N_CELLS; i += 256u) { sum += values[cells[i]]; }
    sums[t] = sum;
    workgroupBarrier();
    for (var reach = 128u; reach > 0u; reach /= 2u) {
        if (t < reach) { sums[t] += sums[t + reach]; }
        workgroupBarrier();
    }
    if (t == 0u) { threshold[0] = min(THRESHOLD, sums[0] / f32(N_CELLS)); }
}
