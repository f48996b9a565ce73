// The buffers of both forms of a layer's gradient.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> partial: array<f32>;
#if ONES
@group(0) @binding(3) var<storage, read> scale: array<vec4<f32>>;
#else
@group(0) @binding(3) var<storage, read> d: array<vec4<f32>>;
#endif
#if SCALED
@group(0) @binding(4) var<storage, read> scale: array<vec4<f32>>;
#endif

