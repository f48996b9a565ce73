// The step of the sharpness: v, its moments, and inv_s = exp(10 v). One workgroup.

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> rates: array<f32>;
@group(0) @binding(2) var<storage, read> of_ray: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> sharpness: array<f32>;

alias TOTAL = f32;

@compute @workgroup_size(256)
fn main(at: Place) {
    let t = at.thread;
    var sum = 0.0;
    for (var r = t; r < control[RAYS_AT]; r += 256u) { sum += of_ray[r].z; }
    let all = total(sum, at);
    if (t == 0u) {
        var m = sharpness[1];
        var v = sharpness[2];
        let gradient = 10.0 * sharpness[3] * all;
        let next = adam(sharpness[0], &m, &v, gradient, LEARNING_RATE * rates[RATES_AT + 3u], rates[RATES_AT + 2u]);
        sharpness[0] = next;
        sharpness[1] = m;
        sharpness[2] = v;
        sharpness[3] = exp(10.0 * next);
    }
}
