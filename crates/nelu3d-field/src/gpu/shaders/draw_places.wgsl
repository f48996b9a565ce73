// Gives the samples of all rays their places, in the order of the rays; those that do not fit in have none. One
// workgroup, of whose rays each thread has some neighboring ones.

const THREADS = 256u;

@group(0) @binding(0) var<storage, read_write> control: array<u32>;
@group(0) @binding(1) var<storage, read_write> rays: array<vec4<u32>>;

// Samples of each thread's rays; then, of its and all before.
var<workgroup> counts: array<u32, THREADS>;
// The last sample that has a place.
var<workgroup> last: atomic<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_id) lid: vec3<u32>) {
    let t = lid.x;
    let n_rays = control[RAYS_AT];
    let share = (n_rays + THREADS - 1u) / THREADS;
    let begin = min(t * share, n_rays);
    let end = min(begin + share, n_rays);
    var count = 0u;
    for (var r = begin; r < end; r++) { count += rays[r].y; }
    counts[t] = count;
    if (t == 0u) { atomicStore(&last, 0u); }
    workgroupBarrier();
    for (var reach = 1u; reach < THREADS; reach *= 2u) {
        var before = 0u;
        if (t >= reach) { before = counts[t - reach]; }
        workgroupBarrier();
        counts[t] += before;
        workgroupBarrier();
    }
    var at = counts[t] - count;
    for (var r = begin; r < end; r++) {
        let ray = rays[r];
        let next = at + ray.y;
        if (next > MAX_SAMPLES) {
            rays[r] = vec4(0u, 0u, ray.z, 1u);
        } else {
            rays[r] = vec4(at, ray.y, ray.z, 0u);
            atomicMax(&last, next);
        }
        at = next;
    }
    workgroupBarrier();
    if (t == 0u) { control[N_AT_SAMPLES] = atomicLoad(&last); }
}
