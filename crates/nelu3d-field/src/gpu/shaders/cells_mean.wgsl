// Occupancy: the threshold, at most the mean over all cells that exist. One workgroup.

@group(0) @binding(0) var<storage, read> cells: array<u32>;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> threshold: array<f32>;

alias TOTAL = f32;

@compute @workgroup_size(256)
fn main(at: Place) {
    let t = at.thread;
    var sum = 0.0;
    for (var i = t; i < N_CELLS; i += 256u) { sum += values[cells[i]]; }
    let all = total(sum, at);
    if (t == 0u) { threshold[0] = min(THRESHOLD, all / f32(N_CELLS)); }
}
