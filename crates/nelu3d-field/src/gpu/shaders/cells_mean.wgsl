// Occupancy: the threshold, at most the mean over all cells that exist. PARTS: the sums of parts of them, one workgroup
// each; then one workgroup that sums these.

#if PARTS
@group(0) @binding(0) var<storage, read> cells: array<u32>;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> parts: array<f32>;
#else
@group(0) @binding(0) var<storage, read> parts: array<f32>;
@group(0) @binding(1) var<storage, read_write> threshold: array<f32>;
#endif

alias TOTAL = f32;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, at: Place) {
    let t = at.thread;
#if PARTS
    var sum = 0.0;
    for (var i = wid.x * 256u + t; i < N_CELLS; i += N_PARTS * 256u) { sum += values[cells[i]]; }
    let all = total(sum, at);
    if (t == 0u) { parts[wid.x] = all; }
#else
    var sum = 0.0;
    for (var i = t; i < N_PARTS; i += 256u) { sum += parts[i]; }
    let all = total(sum, at);
    if (t == 0u) { threshold[0] = min(THRESHOLD, all / f32(N_CELLS)); }
#endif
}
