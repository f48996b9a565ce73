// As layer.wgsl, without a workgroup's memory: four outputs of four points per thread. For software drivers, to which a
// barrier costs more than a load.

@compute @workgroup_size(16)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s4 = id.x;
    if (s4 * 4u >= control[N_AT]) { return; }
    let first = id.y * 4u;
    // Units past the last are computed from the last and not written.
    let j = min(vec4(first, first + 1u, first + 2u, first + 3u), vec4(N_OUT - 1u));
    var sums: array<vec4<f32>, 4>;
    for (var c = 0u; c < 4u; c++) {
        sums[c] = vec4(0.0);
#if BIASED
        sums[c] += weights[WEIGHTS_AT + N_IN * N_OUT + j[c]];
#endif
#if SCALED
        sums[c] += weights[WEIGHTS_AT + N_IN * N_OUT + j[c]] * scale[s4];
#endif
    }
    for (var i = 0u; i < N_IN; i++) {
        let v = a[i * (CAPACITY / 4u) + s4];
#if TRANSPOSED
        let w = WEIGHTS_AT + i * ROW;
        sums[0] += weights[w + j.x] * v;
        sums[1] += weights[w + j.y] * v;
        sums[2] += weights[w + j.z] * v;
        sums[3] += weights[w + j.w] * v;
#else
        let w = WEIGHTS_AT + i;
        sums[0] += weights[w + j.x * ROW] * v;
        sums[1] += weights[w + j.y * ROW] * v;
        sums[2] += weights[w + j.z * ROW] * v;
        sums[3] += weights[w + j.w * ROW] * v;
#endif
    }
    for (var c = 0u; c < 4u; c++) {
        if (first + c >= N_OUT) { continue; }
        let at = (first + c) * (CAPACITY / 4u) + s4;
        result[at] = activated(sums[c], at);
    }
}
