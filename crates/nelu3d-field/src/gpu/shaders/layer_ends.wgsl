// What both forms of a layer share: their buffers, and what becomes of a sum.

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

// From sums to what is written at `at`.
fn activated(sums: vec4<f32>, at: u32) -> vec4<f32> {
    var v = sums;
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
    return v;
}
