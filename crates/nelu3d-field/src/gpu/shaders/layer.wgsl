// A layer for all points: out[j][s] = activation(sum_i w[j][i] a[i][s] + b[j] scale[s]), 64 outputs of 64 points per
// workgroup, 4 x 4 of them per thread. TRANSPOSED takes w[i][j]: the way back. What comes out can be masked by where a
// hidden layer was positive.

const STEP = 16u;
var<workgroup> tile_a: array<vec4<f32>, 256>;
var<workgroup> tile_w: array<f32, 1024>;

fn weight(j: u32, i: u32) -> f32 {
    if (j >= N_OUT || i >= N_IN) { return 0.0; }
#if TRANSPOSED
    return weights[WEIGHTS_AT + i * ROW + j];
#else
    return weights[WEIGHTS_AT + j * ROW + i];
#endif
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let t = lid.x;
    if (wid.x * 64u >= control[N_AT]) { return; }
    let first_j = wid.y * 64u;
    // Points in fours.
    let s4 = wid.x * 16u + t % 16u;
    let j4 = (t / 16u) * 4u;
    var sums: array<vec4<f32>, 4>;
    for (var c = 0u; c < 4u; c++) { sums[c] = vec4(0.0); }
    for (var first = 0u; first < N_IN; first += STEP) {
        let i = first + t / 16u;
        var value = vec4(0.0);
        if (i < N_IN) { value = a[i * (CAPACITY / 4u) + s4]; }
        tile_a[t] = value;
        for (var c = 0u; c < 4u; c++) {
            // tile_w[i][j]
            let at = c * 256u + t;
#if TRANSPOSED
            tile_w[at] = weight(first_j + at % 64u, first + at / 64u);
#else
            tile_w[(at % 16u) * 64u + at / 16u] = weight(first_j + at / 16u, first + at % 16u);
#endif
        }
        workgroupBarrier();
        for (var k = 0u; k < STEP; k++) {
            let v = tile_a[k * 16u + t % 16u];
            let w = k * 64u + j4;
            sums[0] += tile_w[w] * v;
            sums[1] += tile_w[w + 1u] * v;
            sums[2] += tile_w[w + 2u] * v;
            sums[3] += tile_w[w + 3u] * v;
        }
        workgroupBarrier();
    }
    for (var c = 0u; c < 4u; c++) {
        let j = first_j + j4 + c;
        if (j >= N_OUT) { continue; }
        let at = j * (CAPACITY / 4u) + s4;
        var v = sums[c];
#if BIASED
        v += weights[WEIGHTS_AT + N_IN * N_OUT + j];
#endif
#if SCALED
        v += weights[WEIGHTS_AT + N_IN * N_OUT + j] * scale[s4];
#endif
        result[at] = activated(v, at);
    }
}
