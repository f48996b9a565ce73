// Volume rendering of rays with alphas at midpoints, forward and backward: one thread per ray. See surface/codeword.rs
// and volrend/midpoint.rs.

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
// Gradients of the distances in space; then u, what the losses send to them, and the sample's share of the eikonal loss.
@group(0) @binding(8) var<storage, read_write> u_of: array<vec4<f32>>;
// Transmittances before the samples; then the gradients by the distances.
@group(0) @binding(9) var<storage, read_write> s_of: array<f32>;
// Image loss, mask loss, gradient by inv_s.
@group(0) @binding(10) var<storage, read_write> of_ray: array<vec4<f32>>;
// [channel][ray]. Not there without an ambient term.
@group(0) @binding(11) var<storage, read> ambient: array<f32>;

fn robust(r: f32) -> vec2<f32> {
    return vec2(L1 * abs(r) + L2 * r * r, L1 * sign(r) + 2.0 * L2 * r);
}

fn sigmoid(x: f32) -> f32 {
    let e = exp(-abs(x));
    return select(e, 1.0, x >= 0.0) / (1.0 + e);
}

// A sample as the middle of its interval.
struct Middle {
    normal: vec3<f32>,
    // 1 / length of the gradient.
    inv_norm: f32,
    cosine: f32,
    h: f32,
    // At the interval's beginning and end.
    phi: vec2<f32>,
    // 1 - alpha
    passed: f32,
}

fn middle(f: f32, gradient: vec3<f32>, dir: vec3<f32>, anneal: f32, inv_s: f32) -> Middle {
    var m: Middle;
    m.inv_norm = 1.0 / max(sqrt(dot(gradient, gradient)), 1e-12);
    m.normal = gradient * m.inv_norm;
    m.cosine = dot(dir, m.normal);
    let soft = max(0.5 - 0.5 * m.cosine, 0.0);
    let hard = max(-m.cosine, 0.0);
    m.h = HALF_STEP * ((1.0 - anneal) * soft + anneal * hard);
    m.phi = vec2(sigmoid(inv_s * (f + m.h)), sigmoid(inv_s * (f - m.h)));
    m.passed = min(m.phi.y / (m.phi.x + EPSILON_ALPHA), 1.0);
    return m;
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
    let extent = vec3(EXTENT_X, EXTENT_Y, EXTENT_Z);
    let dir = normalize(pixels[pixel].dir * extent);
    let inv_s = sharpness[3];
    var anneal = 1.0;
#if ANNEALED
    anneal = min(f32(control[STEP_AT] - 1u) / ANNEAL_STEPS, 1.0);
#endif

    // Forward.
    var image: array<f32, K>;
    for (var c = 0u; c < K; c++) { image[c] = 0.0; }
    var transmittance = 1.0;
    var opacity = 0.0;
    for (var s = begin; s < begin + count; s++) {
        let passed = middle(sdf[s], u_of[s].xyz, dir, anneal, inv_s).passed;
        let weight = transmittance * (1.0 - passed);
        s_of[s] = transmittance;
        transmittance *= passed;
        opacity += weight;
        for (var c = 0u; c < K; c++) { image[c] += weight * colors[c * CAPACITY + s]; }
    }

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
    let log_t = select(log(transmittance), -708.0, transmittance <= 0.0);
    let o = 1.0 - transmittance;
    mask_loss = -(mask * log(max(o, MIN_OPACITY)) + (1.0 - mask) * log_t);
    var by_log = -(1.0 - mask);
    if (o > MIN_OPACITY) { by_log += mask * transmittance / o; }
    d_log = MASK_WEIGHT * mask_scale * by_log;
#endif

    // Backward.
    let eikonal_share = 1.0 / f32(n_samples);
    var after = 0.0;
    var d_inv_s = 0.0;
    for (var back = 0u; back < count; back++) {
        let s = begin + count - 1u - back;
        let f = sdf[s];
        let gradient = u_of[s].xyz;
        let m = middle(f, gradient, dir, anneal, inv_s);
        let before = s_of[s];
        var d = d_weight;
        for (var c = 0u; c < K; c++) { d += image[c] * colors[c * CAPACITY + s]; }
        let d_alpha = before * d - (after + d_log) / max(m.passed, LEAST_PASSED);
        after += before * (1.0 - m.passed) * d;
        var d_f = 0.0;
        var d_normal = vec3(0.0);
        if (m.passed > 0.0 && m.passed < 1.0) {
            let bottom = m.phi.x + EPSILON_ALPHA;
            let d_phi = vec2(d_alpha * m.phi.y / (bottom * bottom), -d_alpha / bottom);
            let slope = m.phi * (1.0 - m.phi) * d_phi;
            d_f = inv_s * (slope.x + slope.y);
            d_inv_s += slope.x * (f + m.h) + slope.y * (f - m.h);
            let soft = select(0.0, 0.5 * (1.0 - anneal), m.cosine < 1.0);
            let hard = select(0.0, anneal, m.cosine < 0.0);
            d_normal = -inv_s * (slope.x - slope.y) * HALF_STEP * (soft + hard) * dir;
        }
        s_of[s] = d_f - SPARSITY_WEIGHT / f32(n_samples) * sign(f) * exp(-abs(f));
        // What goes to the gradient: across its direction from the alphas, along it from the eikonal loss.
        let excess = 1.0 / m.inv_norm - 1.0;
        var u = (d_normal - dot(m.normal, d_normal) * m.normal) * m.inv_norm;
        u += EIKONAL_WEIGHT * eikonal_share * 2.0 * excess * m.normal;
        u_of[s] = vec4(u / extent, eikonal_share * excess * excess);
    }
    of_ray[r] = vec4(image_loss * image_scale, mask_loss * mask_scale, d_inv_s, 0.0);
}
