// The costs of hypotheses: one thread per pixel and hypothesis. Constants: GROUPS (of four channels), FOLD.

struct About {
    // Cells of the lattice along a, b, w.
    cells: vec3<u32>,
    hypotheses: u32,
    // Cells that are lit or not.
    lit_cells: vec3<u32>,
    // Pixels times hypotheses.
    count: u32,
    prior: vec2<f32>,
    saturation: f32,
    outside: f32,
}

struct Ray {
    origin: vec3<f32>,
    at: f32,
    slope: vec3<f32>,
    bend: f32,
}

@group(0) @binding(0) var<storage, read> about: About;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
// First hypothesis and the one after the last.
@group(0) @binding(2) var<storage, read> ranges: array<vec2<u32>>;
// [pixel][p, inv_var, surround][group]
@group(0) @binding(3) var<storage, read> codewords: array<vec4<f32>>;
// [b][a][w][group]
@group(0) @binding(4) var<storage, read> nodes: array<vec4<f32>>;
// 32 cells a word.
@group(0) @binding(5) var<storage, read> lit: array<u32>;
@group(0) @binding(6) var<storage, read_write> costs: array<f32>;
// 1 where a hypothesis of the pixel is inside.
@group(0) @binding(7) var<storage, read_write> seen: array<atomic<u32>>;

fn weights(f: f32) -> vec4<f32> {
    let g = 1.0 - f;
    let f2 = f * f;
    let g2 = g * g;
    return vec4(g2 * g, 4.0 - f2 * (6.0 - 3.0 * f), 4.0 - g2 * (6.0 - 3.0 * g), f2 * f) / 6.0;
}

fn along_w(at: u32, w: vec4<f32>) -> vec4<f32> {
    return w.x * nodes[at] + w.y * nodes[at + GROUPS] + w.z * nodes[at + 2u * GROUPS] + w.w * nodes[at + 3u * GROUPS];
}

fn along_a(at: u32, stride: u32, a: vec4<f32>, w: vec4<f32>) -> vec4<f32> {
    return a.x * along_w(at, w) + a.y * along_w(at + stride, w)
        + a.z * along_w(at + 2u * stride, w) + a.w * along_w(at + 3u * stride, w);
}

fn total(v: vec4<f32>) -> f32 {
    return (v.x + v.y) + (v.z + v.w);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) wid: vec3<u32>, @builtin(local_invocation_id) lid: vec3<u32>) {
    let i = (wid.y * FOLD + wid.x) * 256u + lid.x;
    if (i >= about.count) {
        return;
    }
    costs[i] = about.outside;
    let pixel = i / about.hypotheses;
    let hypothesis = i - pixel * about.hypotheses;
    let range = ranges[pixel];
    if (hypothesis < range.x || hypothesis >= range.y) {
        return;
    }
    let ray = rays[pixel];
    let d = f32(hypothesis) - ray.at;
    let pole = 1.0 + d * ray.bend;
    if (pole <= 0.0) {
        return;
    }
    let q = ray.origin + ray.slope * (d / pole);
    if (!(all(q >= vec3(0.0)) && all(q <= vec3(1.0)))) {
        return;
    }
    let place = min(vec3<u32>(q * vec3<f32>(about.lit_cells)), about.lit_cells - 1u);
    let bit = (place.y * about.lit_cells.x + place.x) * about.lit_cells.z + place.z;
    if ((lit[bit / 32u] >> (bit % 32u) & 1u) == 0u) {
        return;
    }
    atomicStore(&seen[pixel], 1u);

    let u = q * vec3<f32>(about.cells);
    let cell = min(vec3<u32>(u), about.cells - 1u);
    let f = u - vec3<f32>(cell);
    let wa = weights(f.x);
    let wb = weights(f.y);
    let ww = weights(f.z);
    let stride_a = (about.cells.z + 3u) * GROUPS;
    let stride_b = (about.cells.x + 3u) * stride_a;
    let corner = cell.y * stride_b + cell.x * stride_a + cell.z * GROUPS;

    var aa = vec4(0.0);
    var ab = vec4(0.0);
    var bb = vec4(0.0);
    var af = vec4(0.0);
    var bf = vec4(0.0);
    var ee = vec4(0.0);
    for (var group = 0u; group < GROUPS; group++) {
        let at = corner + group;
        let c = wb.x * along_a(at, stride_a, wa, ww) + wb.y * along_a(at + stride_b, stride_a, wa, ww)
            + wb.z * along_a(at + 2u * stride_b, stride_a, wa, ww)
            + wb.w * along_a(at + 3u * stride_b, stride_a, wa, ww);
        let codeword = pixel * 3u * GROUPS + group;
        let iv = codewords[codeword + GROUPS];
        let r = codewords[codeword] - c;
        let ambient = 1.0 - c;
        let indirect = codewords[codeword + 2u * GROUPS] - c;
        aa += iv * ambient * ambient;
        ab += iv * ambient * indirect;
        bb += iv * indirect * indirect;
        af += iv * ambient * r;
        bf += iv * indirect * r;
        ee += iv * r * r;
    }
    let s = total(ab);
    let a = total(aa) + about.prior.x;
    let b = total(bb) + about.prior.y;
    let fa = total(af);
    let fb = total(bf);
    let det = a * b - s * s;
    var x = vec2(b * fa - s * fb, a * fb - s * fa) / det;
    if (x.x < 0.0) {
        x = vec2(0.0, max(fb / b, 0.0));
    } else if (x.y < 0.0) {
        x = vec2(max(fa / a, 0.0), 0.0);
    }
    x = min(x, vec2(0.45));
    let gain = 2.0 * (x.x * fa + x.y * fb) - a * x.x * x.x - b * x.y * x.y - 2.0 * s * x.x * x.y;
    let e = max(total(ee) - gain, 0.0);
    costs[i] = e / (1.0 + e / about.saturation);
}
