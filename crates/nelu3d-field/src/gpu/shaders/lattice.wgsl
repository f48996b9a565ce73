// The frozen codewords of samples: a uniform tricubic B-spline, nodes [b][a][w][k]; one thread per sample.
// colors[channel][sample].

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> nodes: array<f32>;
// Rows of an affine map from the cube to where the projective one begins; then kappa; then lower corner and scale of
// the unit box.
@group(0) @binding(3) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> colors: array<f32>;

fn weights(f: f32) -> vec4<f32> {
    let g = 1.0 - f;
    return vec4(
        g * g * g / 6.0,
        (4.0 - f * f * (6.0 - 3.0 * f)) / 6.0,
        (4.0 - g * g * (6.0 - 3.0 * g)) / 6.0,
        f * f * f / 6.0,
    );
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let s = id.x;
    if (s >= control[N_AT]) { return; }
    let p = vec4(points[s].xyz, 1.0);
    let y = vec3(dot(frame[0], p), dot(frame[1], p), dot(frame[2], p));
    let shrink = 1.0 / max(1.0 + frame[3].x * y.z, 1e-6);
    let q = (y * shrink - frame[4].xyz) * frame[5].xyz;
    let cells = vec3(CELLS_A, CELLS_B, CELLS_W);
    let u = clamp(q * vec3<f32>(cells), vec3(0.0), vec3<f32>(cells));
    let cell = min(vec3<u32>(u), cells - 1u);
    let f = u - vec3<f32>(cell);
    let wa = weights(f.x);
    let wb = weights(f.y);
    let ww = weights(f.z);
    var sum: array<f32, K>;
    for (var c = 0u; c < K; c++) { sum[c] = 0.0; }
    for (var j = 0u; j < 4u; j++) {
        for (var i = 0u; i < 4u; i++) {
            let ab = wa[i] * wb[j];
            let at = (((cell.y + j) * (CELLS_A + 3u) + cell.x + i) * (CELLS_W + 3u) + cell.z) * K;
            for (var l = 0u; l < 4u; l++) {
                let w = ab * ww[l];
                for (var c = 0u; c < K; c++) { sum[c] += w * nodes[at + l * K + c]; }
            }
        }
    }
    for (var c = 0u; c < K; c++) { colors[c * CAPACITY + s] = sum[c]; }
}
