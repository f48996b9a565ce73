// Volume rendering of rays, forward and backward: one thread per ray. See surface/codeword.rs and volrend/cpu.rs; here
// in single precision.

struct Pixel {
    dir: vec3<f32>,
    near: f32,
    place: vec2<f32>,
    far: f32,
    mask: f32,
}

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> pixels: array<Pixel>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> sdf: array<f32>;
@group(0) @binding(4) var<storage, read> colors: array<f32>;
// [pixel]: k codewords, then the white of every channel.
@group(0) @binding(5) var<storage, read> measured: array<f32>;
@group(0) @binding(6) var<storage, read> sharpness: array<f32>;
// [channel][ray], by the ambient network's sums.
@group(0) @binding(7) var<storage, read_write> d_ambient: array<f32>;
// Share that an interval lets pass, transmittance behind it, weight.
@group(0) @binding(8) var<storage, read_write> steps: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> s_of: array<f32>;
// Image loss, mask loss, gradient by inv_s.
@group(0) @binding(10) var<storage, read_write> of_ray: array<vec4<f32>>;
// [channel][ray]. Not there without an ambient term.
@group(0) @binding(11) var<storage, read> ambient: array<f32>;

fn robust(r: f32) -> vec2<f32> {
    return vec2(L1 * abs(r) + L2 * r * r, L1 * sign(r) + 2.0 * L2 * r);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let r = id.x;
    let n_rays = control[RAYS_AT];
    if (r >= n_rays) { return; }
    let n_samples = control[N_AT_SAMPLES];
    let ray = rays[r];
    if (ray.w != 0u) {
        of_ray[r] = vec4(0.0);
        for (var c = 0u; c < N_CHANNELS; c++) { d_ambient[c * RAY_CAPACITY + r] = 0.0; }
        return;
    }
    let begin = ray.x;
    let count = ray.y;
    let pixel = ray.z;
    let mask = pixels[pixel].mask;
    let inv_s = sharpness[3];

    // Forward.
    var image: array<f32, K>;
    for (var c = 0u; c < K; c++) { image[c] = 0.0; }
    var transmittance = 1.0;
    var log_transmittance = 0.0;
    var opacity = 0.0;
    var base_before = 0.0;
    var factor_before = 1.0;
    for (var j = 0u; j < count; j++) {
        let s = begin + j;
        let x = inv_s * sdf[s];
        let factor = 1.0 + exp(-abs(x));
        let base = min(x, 0.0);
        if (j > 0u) {
            let through = min(base - base_before + log(factor_before / factor), 0.0);
            let passed = exp(through);
            let weight = transmittance * (1.0 - passed);
            transmittance *= passed;
            log_transmittance += through;
            opacity += weight;
            steps[s - 1u] = vec4(passed, transmittance, weight, 0.0);
            for (var c = 0u; c < K; c++) { image[c] += weight * colors[c * CAPACITY + s - 1u]; }
        }
        base_before = base;
        factor_before = factor;
    }
    if (count > 0u) { steps[begin + count - 1u] = vec4(1.0, transmittance, 0.0, 0.0); }

    // Losses, and what they send to the image.
    let per_pixel = K + N_CHANNELS;
    let image_scale = 1.0 / f32(n_rays * K);
    let mask_scale = 1.0 / f32(n_rays);
    var d_share: array<f32, N_CHANNELS>;
    for (var c = 0u; c < N_CHANNELS; c++) { d_share[c] = 0.0; }
    var image_loss = 0.0;
    for (var c = 0u; c < K; c++) {
        let channel = c % N_CHANNELS;
        let white = measured[pixel * per_pixel + K + channel];
        var share = 0.0;
#if BOUNDED
        share = ambient[channel * RAY_CAPACITY + r];
#endif
#if UNBOUNDED
        share = ambient[channel * RAY_CAPACITY + r] / max(white, MIN_WHITE);
#endif
        let residual = image[c] * (1.0 - share) + share - measured[pixel * per_pixel + c];
        let lookup = robust(residual);
        let pattern = robust(white * residual);
        image_loss += (1.0 - ALPHA) * pattern.x + ALPHA * lookup.x;
        let d = ((1.0 - ALPHA) * white * pattern.y + ALPHA * lookup.y) * image_scale;
        d_share[channel] += d * (1.0 - image[c]);
        // From here on its gradient.
        image[c] = d * (1.0 - share);
    }
    for (var c = 0u; c < N_CHANNELS; c++) {
        var d = 0.0;
#if BOUNDED
        let a = ambient[c * RAY_CAPACITY + r];
        d = d_share[c] * a * (1.0 - a);
#endif
#if UNBOUNDED
        let a = ambient[c * RAY_CAPACITY + r];
        d = d_share[c] * a * (1.0 - a) / max(measured[pixel * per_pixel + K + c], MIN_WHITE);
#endif
        d_ambient[c * RAY_CAPACITY + r] = d;
    }
    var mask_loss = 0.0;
    var d_weight = 0.0;
    var d_log = 0.0;
#if CLAMPED
    let o = clamp(opacity, MASK_CLAMP, 1.0 - MASK_CLAMP);
    mask_loss = -(mask * log(o) + (1.0 - mask) * log(1.0 - o));
    if (opacity >= MASK_CLAMP && opacity <= 1.0 - MASK_CLAMP) {
        d_weight = MASK_WEIGHT * mask_scale * (o - mask) / (o * (1.0 - o));
    }
#else
    let log_t = max(log_transmittance, -708.0);
    let o = 1.0 - exp(log_t);
    mask_loss = -(mask * log(max(o, MIN_OPACITY)) + (1.0 - mask) * log_t);
    var by_log = -(1.0 - mask);
    if (o > MIN_OPACITY) { by_log += mask * exp(log_t) / o; }
    d_log = MASK_WEIGHT * mask_scale * by_log;
#endif

    // Backward.
    var after = 0.0;
    var opened = 0.0;
    var d_inv_s = 0.0;
    for (var back = 0u; back < count; back++) {
        let s = begin + count - 1u - back;
        let f = sdf[s];
        var closed = 0.0;
        if (s > begin) {
            var d = d_weight;
            var d_before = d_weight;
            for (var c = 0u; c < K; c++) {
                d += image[c] * colors[c * CAPACITY + s];
                d_before += image[c] * colors[c * CAPACITY + s - 1u];
            }
            after += steps[s].z * d;
            // No gradient where the clamp to alpha >= 0 acts.
            let before = steps[s - 1u];
            if (before.x < 1.0) { closed = after - before.y * d_before + d_log; }
        }
        let x = inv_s * f;
        let e = exp(-abs(x));
        let complement = select(e, 1.0, x < 0.0) / (1.0 + e);
        let slope = (closed - opened) * complement;
        d_inv_s += slope * f;
        opened = closed;
        s_of[s] = slope * inv_s - SPARSITY_WEIGHT / f32(n_samples) * sign(f) * exp(-abs(f));
    }
    of_ray[r] = vec4(image_loss * image_scale, mask_loss * mask_scale, d_inv_s, 0.0);
}
