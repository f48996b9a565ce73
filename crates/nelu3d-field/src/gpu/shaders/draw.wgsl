// Draws rays and samples them in the occupied part of the cube: one workgroup per ray, of whose steps each thread has
// some neighboring ones. Counts the samples first; with SAMPLES, when their place is known, writes them.

struct Pixel {
    // Direction, in the cube's units per unit of t.
    dir: vec3<f32>,
    near: f32,
    place: vec2<f32>,
    far: f32,
    mask: f32,
}

const THREADS = 64u;

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> pixels: array<Pixel>;
@group(0) @binding(2) var<storage, read> occupied: array<u32>;
// First sample, number of samples, pixel, whether there was no room for it.
@group(0) @binding(3) var<storage, read_write> rays: array<vec4<u32>>;
#if SAMPLES
@group(0) @binding(4) var<storage, read_write> points: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> places: array<vec4<f32>>;
#endif

// Samples of each thread; then, of it and all before it.
var<workgroup> counts: array<u32, THREADS>;

fn is_occupied(p: vec3<f32>) -> bool {
    let at = p * f32(CELLS);
    if (any(at < vec3(0.0)) || any(at >= vec3(f32(CELLS)))) { return false; }
    let c = vec3<u32>(at);
    let cell = (c.z * CELLS + c.y) * CELLS + c.x;
    return ((occupied[cell / 32u] >> (cell % 32u)) & 1u) == 1u;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let r = wid.x;
    let t = lid.x;
    if (r >= control[RAYS_AT]) { return; }
    let chance = random(SEED, control[STEP_AT], r);
    let i = min(u32(chance.x * f32(N_PIXELS)), N_PIXELS - 1u);
    let pixel = pixels[i];
    let origin = vec3(ORIGIN_X, ORIGIN_Y, ORIGIN_Z);
    let first = pixel.near + chance.y * STEP_T;
    var n = 0u;
    if (pixel.near < pixel.far) { n = u32(max(0.0, ceil((pixel.far - pixel.near) / STEP_T - chance.y))); }
    let share = (n + THREADS - 1u) / THREADS;
    let begin = min(t * share, n);
    let end = min(begin + share, n);
    var count = 0u;
    for (var j = begin; j < end; j++) {
        if (is_occupied(origin + (first + f32(j) * STEP_T) * pixel.dir)) { count++; }
    }
    counts[t] = count;
    workgroupBarrier();
    for (var reach = 1u; reach < THREADS; reach *= 2u) {
        var before = 0u;
        if (t >= reach) { before = counts[t - reach]; }
        workgroupBarrier();
        counts[t] += before;
        workgroupBarrier();
    }
#if SAMPLES
    if (t == 0u) { places[r] = vec4(pixel.place, 0.0, 1.0); }
    // A place for all of them, or none.
    if (rays[r].w != 0u) { return; }
    var at = rays[r].x + counts[t] - count;
    for (var j = begin; j < end; j++) {
        let along = first + f32(j) * STEP_T;
        let p = origin + along * pixel.dir;
        if (is_occupied(p)) {
            points[at] = vec4(p, along);
            at++;
        }
    }
#else
    if (t == 0u) { rays[r] = vec4(0u, counts[THREADS - 1u], i, 0u); }
#endif
}
