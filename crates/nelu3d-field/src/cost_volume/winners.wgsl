// The best hypothesis of every pixel, and its margin. One workgroup per pixel; its threads share the hypotheses.
// Constants: THREADS (a multiple of 8), NEAR, FOLD. Preceded by place.wgsl.

struct About {
    pixels: u32,
    hypotheses: u32,
    outside: f32,
}

const LARGE = 1e30;

@group(0) @binding(0) var<storage, read> about: About;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(2) var<storage, read> costs: array<f32>;
@group(0) @binding(3) var<storage, read> sums: array<f32>;
// Label, −1 where there is none, and margin, −1 where there is no rival.
@group(0) @binding(4) var<storage, read_write> found: array<vec2<f32>>;

#if SUBGROUPS
// One of every subgroup: least sum and its hypothesis, and the rival's.
var<workgroup> of_waves: array<vec2<f32>, THREADS / 4u>;
var<workgroup> rivals: array<f32, THREADS / 4u>;
#else
var<workgroup> values: array<f32, THREADS>;
var<workgroup> hypotheses_of: array<u32, THREADS>;
var<workgroup> few: array<f32, 8>;
var<workgroup> hypotheses_of_few: array<u32, 8>;
#endif

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, at: Place) {
    let pixel = wid.y * FOLD + wid.x;
    let thread = at.thread;
    if (pixel >= about.pixels) {
        return;
    }
    if (seen[pixel] == 0u) {
        if (thread == 0u) {
            found[pixel] = vec2(-1.0, 0.0);
        }
        return;
    }
    let hypotheses = about.hypotheses;
    let row = pixel * hypotheses;

    // Of equal sums the first hypothesis.
    var least = LARGE;
    var best = 0xffffffffu;
    for (var l = thread; l < hypotheses; l += THREADS) {
        let v = sums[row + l];
        if (v < least) {
            least = v;
            best = l;
        }
    }
#if SUBGROUPS
    // Labels fit into a float's mantissa.
    let least_here = subgroupMin(least);
    let best_here = subgroupMin(select(0xffffffffu, best, least == least_here));
    if (at.lane == 0u) {
        of_waves[at.wave] = vec2(least_here, f32(best_here));
    }
    workgroupBarrier();
    var winner = of_waves[0];
    for (var j = 1u; j < at.waves; j++) {
        let other = of_waves[j];
        if (other.x < winner.x || (other.x == winner.x && other.y < winner.y)) {
            winner = other;
        }
    }
    least = winner.x;
    best = u32(winner.y);
#else
    values[thread] = least;
    hypotheses_of[thread] = best;
    workgroupBarrier();
    if (thread < 8u) {
        for (var j = thread + 8u; j < THREADS; j += 8u) {
            let v = values[j];
            if (v < least || (v == least && hypotheses_of[j] < best)) {
                least = v;
                best = hypotheses_of[j];
            }
        }
        few[thread] = least;
        hypotheses_of_few[thread] = best;
    }
    workgroupBarrier();
    least = few[0];
    best = hypotheses_of_few[0];
    for (var j = 1u; j < 8u; j++) {
        let v = few[j];
        if (v < least || (v == least && hypotheses_of_few[j] < best)) {
            least = v;
            best = hypotheses_of_few[j];
        }
    }
#endif

    var rival = LARGE;
    for (var l = thread; l < hypotheses; l += THREADS) {
        if (l + NEAR < best || l > best + NEAR) {
            rival = min(rival, sums[row + l]);
        }
    }
#if SUBGROUPS
    rival = subgroupMin(rival);
    if (at.lane == 0u) {
        rivals[at.wave] = rival;
    }
    workgroupBarrier();
    if (thread > 0u) {
        return;
    }
    for (var j = 0u; j < at.waves; j++) {
        rival = min(rival, rivals[j]);
    }
#else
    // Read by all threads before the first barrier, and by eight of them before the second.
    values[thread] = rival;
    workgroupBarrier();
    if (thread < 8u) {
        for (var j = thread + 8u; j < THREADS; j += 8u) {
            rival = min(rival, values[j]);
        }
        few[thread] = rival;
    }
    workgroupBarrier();
    if (thread > 0u) {
        return;
    }
    for (var j = 1u; j < 8u; j++) {
        rival = min(rival, few[j]);
    }
#endif
    if (costs[row + best] >= about.outside) {
        found[pixel] = vec2(-1.0, 0.0);
        return;
    }
    var hypothesis = f32(best);
    if (best > 0u && best + 1u < hypotheses) {
        let a = sums[row + best - 1u];
        let c = sums[row + best + 1u];
        let bend = a - 2.0 * least + c;
        if (bend > 1e-6 && a < about.outside && c < about.outside) {
            hypothesis += clamp(0.5 * (a - c) / bend, -0.5, 0.5);
        }
    }
    found[pixel] = vec2(hypothesis, select(-1.0, (rival - least) / 8.0, rival < LARGE));
}
