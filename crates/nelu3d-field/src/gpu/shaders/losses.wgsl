// Losses of a step, for the record: image, mask, eikonal, sparsity. One workgroup.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> of_ray: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> u_of: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sdf: array<f32>;
@group(0) @binding(4) var<storage, read_write> losses: array<vec4<f32>>;

alias TOTAL = vec4<f32>;

@compute @workgroup_size(256)
fn main(at: Place) {
    let t = at.thread;
    var sum = vec4(0.0);
    for (var r = t; r < control[RAYS_AT]; r += 256u) { sum += vec4(of_ray[r].xy, 0.0, 0.0); }
    let n = control[N_AT];
    for (var s = t; s < n; s += 256u) { sum += vec4(0.0, 0.0, u_of[s].w, exp(-abs(sdf[s])) / f32(n)); }
    let all = total(sum, at);
    if (t == 0u) { losses[0] = all; }
}
