// Path costs in one direction over some rows of the image, added to the sums. One workgroup walks along one line; its
// threads share the hypotheses. Constants: CAPACITY (at most that many hypotheses), THREADS (a multiple of 16), FOLD.
// Preceded by place.wgsl.

struct About {
    direction: vec2<i32>,
    width: i32,
    // Of the whole image.
    height: i32,
    // First of the rows, and how many.
    row: i32,
    rows: i32,
    lines: i32,
    hypotheses: u32,
    step: f32,
    jump: f32,
    // 1: there are no sums yet.
    first: u32,
}

const NONE = 0xffffffffu;
const WIDE = CAPACITY + 2u;
const LARGE = 1e30;

@group(0) @binding(0) var<storage, read> about: About;
// Place in `costs` of each pixel of these rows; NONE where there is none.
@group(0) @binding(1) var<storage, read> slots: array<u32>;
@group(0) @binding(2) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read> costs: array<f32>;
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;
// Path costs at the last pixel of every line in the rows before these, and whether there are any.
@group(0) @binding(5) var<storage, read_write> carry: array<f32>;

// Path costs of the pixel before and of this one, by turns, with a wall at either end.
var<workgroup> paths: array<f32, 2u * WIDE>;
#if SUBGROUPS
// Least path cost of every subgroup, of the pixel before and of this one, by turns.
var<workgroup> least_of_waves: array<f32, 2u * (THREADS / 4u)>;
#else
var<workgroup> least_of: array<f32, THREADS>;
var<workgroup> least_of_those: array<f32, 16>;
#endif

// Where a pixel's costs are; NONE where a path breaks.
fn place(x: i32, y: i32) -> u32 {
    let slot = slots[u32((y - about.row) * about.width + x)];
    if (slot != NONE) {
        if (seen[slot] == 0u) {
            return NONE;
        }
    }
    return slot;
}

#if SUBGROUPS
// Notes the least of all threads' values, once all threads have come here; `turn` is 0 or 1, and not the one of the
// call before.
fn gather(at: Place, turn: u32, least: f32) {
    let m = subgroupMin(least);
    if (at.lane == 0u) {
        least_of_waves[turn * (THREADS / 4u) + at.wave] = m;
    }
    workgroupBarrier();
}

fn gathered(at: Place, turn: u32) -> f32 {
    var least = LARGE;
    for (var j = 0u; j < at.waves; j++) {
        least = min(least, least_of_waves[turn * (THREADS / 4u) + j]);
    }
    return least;
}
#else
fn gather(at: Place, turn: u32, least: f32) {
    let thread = at.thread;
    least_of[thread] = least;
    workgroupBarrier();
    if (thread < 16u) {
        var m = least_of[thread];
        for (var j = thread + 16u; j < THREADS; j += 16u) {
            m = min(m, least_of[j]);
        }
        least_of_those[thread] = m;
    }
    workgroupBarrier();
}

fn gathered(at: Place, turn: u32) -> f32 {
    var least = LARGE;
    for (var j = 0u; j < 16u; j++) {
        least = min(least, least_of_those[j]);
    }
    return least;
}
#endif

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) wid: vec3<u32>, at: Place) {
    let line = i32(wid.y * FOLD + wid.x);
    let thread = at.thread;
    let hypotheses = about.hypotheses;
    if (line >= about.lines) {
        return;
    }
    let dx = about.direction.x;
    let dy = about.direction.y;
    var x = select(about.width - 1, 0, dx > 0);
    var y = about.row + line;
    var length = about.width;
    var begun = false;
    var goes_on = false;
    if (dy != 0) {
        // Rows by the order in which they are met. A line begins and ends at the image's border.
        let row = select(about.height - about.row - about.rows, about.row, dy > 0);
        var begin = 0;
        var end = about.height;
        if (dx > 0) {
            begin = max(0, about.height - 1 - line);
            end = min(end, about.width + about.height - 1 - line);
        } else if (dx < 0) {
            begin = max(0, line - about.width + 1);
            end = min(end, line + 1);
        }
        let here = max(begin, row);
        let there = min(end, row + about.rows);
        length = there - here;
        begun = here > begin;
        goes_on = there < end;
        y = select(about.height - 1 - here, here, dy > 0);
        x = line + dx * here - select(0, about.height - 1, dx > 0);
    }
    if (length <= 0) {
        return;
    }

    var now = 0u;
    var has = false;
    let saved = u32(line) * (hypotheses + 1u);
    if (thread == 0u) {
        paths[0] = LARGE;
        paths[hypotheses + 1u] = LARGE;
        paths[WIDE] = LARGE;
        paths[WIDE + hypotheses + 1u] = LARGE;
    }
    if (begun) {
        has = carry[saved + hypotheses] > 0.5;
        var least = LARGE;
        for (var l = thread; l < hypotheses; l += THREADS) {
            let path = carry[saved + l];
            paths[l + 1u] = path;
            least = min(least, path);
        }
        gather(at, 0u, least);
    } else {
        workgroupBarrier();
    }

    var next = place(x, y);
    for (var i = 0; i < length; i++) {
        let slot = next;
        // One pixel ahead, so that nobody waits for it.
        x += dx;
        y += dy;
        if (i + 1 < length) {
            next = place(x, y);
        }
        if (slot != NONE) {
            let before = now;
            now = WIDE - now;
            let least_before = gathered(at, before / WIDE);
            let far = least_before + about.jump;
            var least = LARGE;
            for (var l = thread; l < hypotheses; l += THREADS) {
                let cost = slot * hypotheses + l;
                var path = costs[cost];
                if (has) {
                    let near = min(paths[before + l], paths[before + l + 2u]) + about.step;
                    path = path + min(min(paths[before + l + 1u], far), near) - least_before;
                }
                paths[now + l + 1u] = path;
                least = min(least, path);
                if (about.first == 1u) {
                    sums[cost] = path;
                } else {
                    sums[cost] += path;
                }
            }
            gather(at, now / WIDE, least);
        }
        has = slot != NONE;
    }

    if (goes_on) {
        for (var l = thread; l < hypotheses; l += THREADS) {
            carry[saved + l] = paths[now + l + 1u];
        }
        if (thread == 0u) {
            carry[saved + hypotheses] = select(0.0, 1.0, has);
        }
    }
}
