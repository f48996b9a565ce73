// The optimizer of the table: entries whose gradient is not zero, which is then cleared.

@group(0) @binding(0) var<storage, read> rates: array<f32>;
@group(0) @binding(1) var<storage, read_write> d_table: array<f32>;
@group(0) @binding(2) var<storage, read_write> table: array<f32>;
@group(0) @binding(3) var<storage, read_write> first: array<f32>;
@group(0) @binding(4) var<storage, read_write> second: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let i = (wid.y * FOLD + wid.x) * 256u + lid.x;
    if (i >= N_TABLE) { return; }
    let g = d_table[i];
    if (g == 0.0) { return; }
    d_table[i] = 0.0;
    var m = first[i];
    var v = second[i];
    table[i] = adam(table[i], &m, &v, g, rates[RATES_AT], rates[RATES_AT + 2u]);
    first[i] = m;
    second[i] = v;
}
