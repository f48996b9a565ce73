// As gradient.wgsl, without a workgroup's memory: 4 x 4 weights of one chunk per thread. For software drivers.

@compute @workgroup_size(1, 8, 1)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = control[N_AT];
    let first_i = id.y * 4u;
    let first_j = id.z * 4u;
    if (first_i >= N_IN) { return; }
    let length = ((n + N_CHUNKS * 16u - 1u) / (N_CHUNKS * 16u)) * 16u;
    let begin = id.x * length;
    let end = min(begin + length, n);
    var sums: array<vec4<f32>, 4>;
    for (var c = 0u; c < 4u; c++) { sums[c] = vec4(0.0); }
    var biases = vec4(0.0);
    for (var s = begin; s < end; s += 4u) {
        // What lies behind the last point is not a number to be trusted.
        let there = vec4(s, s + 1u, s + 2u, s + 3u) < vec4(n);
        var v: array<vec4<f32>, 4>;
        for (var e = 0u; e < 4u; e++) {
            let of_x = x[min(first_i + e, N_IN - 1u) * (CAPACITY / 4u) + s / 4u];
            v[e] = select(vec4(0.0), of_x, there);
        }
        var factor = vec4(1.0);
#if ONES
        factor = scale[s / 4u];
#endif
#if SCALED
        factor = scale[s / 4u];
#endif
        factor = select(vec4(0.0), factor, there);
        for (var c = 0u; c < 4u; c++) {
            var g = vec4(1.0);
#if ONES
#else
            g = d[min(first_j + c, N_OUT - 1u) * (CAPACITY / 4u) + s / 4u];
#endif
            g = select(vec4(0.0), g, there);
            sums[c] += vec4(dot(g, v[0]), dot(g, v[1]), dot(g, v[2]), dot(g, v[3]));
            biases[c] += dot(g, factor);
        }
    }
    let here = id.x * N_PARAMS + WEIGHTS_AT;
    for (var c = 0u; c < 4u; c++) {
        let j = first_j + c;
        if (j >= N_OUT) { continue; }
        for (var e = 0u; e < 4u; e++) {
            let i = first_i + e;
            if (i < N_IN) { partial[here + j * N_IN + i] = sums[c][e]; }
        }
        if (first_i == 0u) { partial[here + N_IN * N_OUT + j] = biases[c]; }
    }
}
