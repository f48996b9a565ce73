// Draws rays and samples them in the occupied part of the cube: one thread per ray.

struct Pixel {
    // Direction, in the cube's units per unit of t.
    dir: vec3<f32>,
    near: f32,
    place: vec2<f32>,
    far: f32,
    mask: f32,
}

@group(0) @binding(0) var<storage, read_write> control: array<atomic<u32>>;
@group(0) @binding(1) var<storage, read> pixels: array<Pixel>;
@group(0) @binding(2) var<storage, read> occupied: array<u32>;
// First sample, number of samples, pixel, whether there was no room for it.
@group(0) @binding(3) var<storage, read_write> rays: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read_write> points: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> places: array<vec4<f32>>;

fn is_occupied(p: vec3<f32>) -> bool {
    let at = p * f32(CELLS);
    if (any(at < vec3(0.0)) || any(at >= vec3(f32(CELLS)))) { return false; }
    let c = vec3<u32>(at);
    let cell = (c.z * CELLS + c.y) * CELLS + c.x;
    return ((occupied[cell / 32u] >> (cell % 32u)) & 1u) == 1u;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let r = id.x;
    if (r >= atomicLoad(&control[RAYS_AT])) { return; }
    let chance = random(SEED, atomicLoad(&control[STEP_AT]), r);
    let i = min(u32(chance.x * f32(N_PIXELS)), N_PIXELS - 1u);
    let pixel = pixels[i];
    let origin = vec3(ORIGIN_X, ORIGIN_Y, ORIGIN_Z);
    let first = pixel.near + chance.y * STEP_T;
    var n = 0u;
    if (pixel.near < pixel.far) { n = u32(max(0.0, ceil((pixel.far - pixel.near) / STEP_T - chance.y))); }
    var count = 0u;
    for (var j = 0u; j < n; j++) {
        if (is_occupied(origin + (first + f32(j) * STEP_T) * pixel.dir)) { count++; }
    }
    // A place for all of them, or none.
    var begin = atomicLoad(&control[N_AT_SAMPLES]);
    var dropped = 0u;
    loop {
        if (begin + count > MAX_SAMPLES) {
            count = 0u;
            dropped = 1u;
            break;
        }
        let answer = atomicCompareExchangeWeak(&control[N_AT_SAMPLES], begin, begin + count);
        if (answer.exchanged) { break; }
        begin = answer.old_value;
    }
    rays[r] = vec4(begin, count, i, dropped);
    places[r] = vec4(pixel.place, 0.0, 1.0);
    if (count == 0u) { return; }
    var at = begin;
    for (var j = 0u; j < n && at < begin + count; j++) {
        let t = first + f32(j) * STEP_T;
        let p = origin + t * pixel.dir;
        if (is_occupied(p)) {
            points[at] = vec4(p, t);
            at++;
        }
    }
}
