// As layer.wgsl, without a workgroup's memory: four outputs of four points per thread. For software drivers, to which a barrier costs
// more than a load.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
@group(0) @binding(2) var<storage, read> a: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> result: array<vec4<f32>>;
#if MASKED
@group(0) @binding(4) var<storage, read> mask: array<vec4<f32>>;
#endif
#if SCALED
@group(0) @binding(4) var<storage, read> scale: array<vec4<f32>>;
#endif

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
        var v = sums[c];
#if RELU
        v = max(v, vec4(0.0));
#endif
#if SIGMOID
        v = 1.0 / (1.0 + exp(-v));
#endif
#if MASKED
        v = select(vec4(0.0), v, mask[at] > vec4(0.0));
#endif
#if MASKED_BY_ITSELF
        v = select(vec4(0.0), v, result[at] > vec4(0.0));
#endif
        result[at] = v;
    }
}
