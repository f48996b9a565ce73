// Gradient of a layer's weights and biases over one chunk of points: partial[chunk][weight] = sum_s d[j][s] x[i][s],
// biases sum_s d[j][s] scale[s]; 64 x 64 weights per workgroup, 4 x 4 per thread. SCALED: scale is not 1. ONES: d is 1,
// and scale is not.

const STEP = 16u;
// [point][unit], a column wider than needed: threads that write a row then meet different banks.
var<workgroup> tile_d: array<f32, 1088>;
var<workgroup> tile_x: array<f32, 1088>;
const WIDE = 68u;
var<workgroup> tile_scale: array<f32, 16>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let t = lid.x;
    let n = control[N_AT];
    let first_j = wid.y * 64u;
    let first_i = wid.z * 64u;
    // Whole steps per chunk.
    let length = ((n + N_CHUNKS * STEP - 1u) / (N_CHUNKS * STEP)) * STEP;
    let begin = wid.x * length;
    let end = min(begin + length, n);
    let row = t / 4u;
    let i4 = (t % 16u) * 4u;
    let j4 = (t / 16u) * 4u;
    var sums: array<vec4<f32>, 4>;
    for (var c = 0u; c < 4u; c++) { sums[c] = vec4(0.0); }
    var biases = vec4(0.0);
    for (var first = begin; first < end; first += STEP) {
        // Four points of one unit per thread; what lies behind the last point is not a number to be trusted.
        let s = first + (t % 4u) * 4u;
        let there = vec4(s, s + 1u, s + 2u, s + 3u) < vec4(n);
        var of_d = vec4(0.0);
        if (first_j + row < N_OUT) {
#if ONES
            of_d = vec4(1.0);
#else
            of_d = d[(first_j + row) * (CAPACITY / 4u) + s / 4u];
#endif
        }
        of_d = select(vec4(0.0), of_d, there);
        var of_x = vec4(0.0);
        if (first_i + row < N_IN) { of_x = x[(first_i + row) * (CAPACITY / 4u) + s / 4u]; }
        of_x = select(vec4(0.0), of_x, there);
        let at = (t % 4u) * 4u * WIDE + row;
        tile_d[at] = of_d.x;
        tile_d[at + WIDE] = of_d.y;
        tile_d[at + 2u * WIDE] = of_d.z;
        tile_d[at + 3u * WIDE] = of_d.w;
        tile_x[at] = of_x.x;
        tile_x[at + WIDE] = of_x.y;
        tile_x[at + 2u * WIDE] = of_x.z;
        tile_x[at + 3u * WIDE] = of_x.w;
        if (t < STEP) {
            var factor = 1.0;
#if ONES
            factor = scale[(first + t) / 4u][t % 4u];
#endif
#if SCALED
            factor = scale[(first + t) / 4u][t % 4u];
#endif
            tile_scale[t] = select(0.0, factor, first + t < n);
        }
        workgroupBarrier();
        for (var k = 0u; k < STEP; k++) {
            let at_d = k * WIDE + j4;
            let at_x = k * WIDE + i4;
            let v = vec4(tile_x[at_x], tile_x[at_x + 1u], tile_x[at_x + 2u], tile_x[at_x + 3u]);
            let g = vec4(tile_d[at_d], tile_d[at_d + 1u], tile_d[at_d + 2u], tile_d[at_d + 3u]);
            sums[0] += g.x * v;
            sums[1] += g.y * v;
            sums[2] += g.z * v;
            sums[3] += g.w * v;
            biases += g * tile_scale[k];
        }
        workgroupBarrier();
    }
    let here = wid.x * N_PARAMS + WEIGHTS_AT;
    for (var c = 0u; c < 4u; c++) {
        let j = first_j + j4 + c;
        if (j >= N_OUT) { continue; }
        for (var e = 0u; e < 4u; e++) {
            let i = first_i + i4 + e;
            if (i < N_IN) { partial[here + j * N_IN + i] = sums[c][e]; }
        }
        if (first_i == 0u && i4 == 0u) { partial[here + N_IN * N_OUT + j] = biases[c]; }
    }
}
