// The optimizer of the network: one thread per unit, with its weights and its bias. NORMALIZED: through weight
// normalization, see mlp/weight_norm.rs; raw parameters are the network's, then the units' lengths.

struct Unit { weights_at: u32, n_in: u32, bias_at: u32, unused: u32 }

@group(0) @binding(0) var<storage, read> rates: array<f32>;
@group(0) @binding(1) var<storage, read> units: array<Unit>;
@group(0) @binding(2) var<storage, read> gradient: array<f32>;
@group(0) @binding(3) var<storage, read_write> weights: array<f32>;
@group(0) @binding(4) var<storage, read_write> raw: array<f32>;
@group(0) @binding(5) var<storage, read_write> first: array<f32>;
@group(0) @binding(6) var<storage, read_write> second: array<f32>;

fn update(i: u32, g: f32) -> f32 {
    var m = first[i];
    var v = second[i];
    let p = adam(raw[i], &m, &v, g, rates[RATES_AT + 1u], rates[RATES_AT + 2u]);
    first[i] = m;
    second[i] = v;
    raw[i] = p;
    return p;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= N_UNITS) { return; }
    let unit = units[id.x];
    let begin = unit.weights_at;
    let end = begin + unit.n_in;
    weights[unit.bias_at] = update(unit.bias_at, gradient[unit.bias_at]);
#if NORMALIZED
    var square = 0.0;
    var product = 0.0;
    for (var i = begin; i < end; i++) {
        square += raw[i] * raw[i];
        product += raw[i] * gradient[i];
    }
    let length = max(sqrt(square), 1e-15);
    let along = product / length;
    let g_at = N_PARAMS + id.x;
    let scale = raw[g_at] / length;
    square = 0.0;
    for (var i = begin; i < end; i++) {
        let v = update(i, scale * (gradient[i] - along * raw[i] / length));
        square += v * v;
    }
    let factor = update(g_at, along) / max(sqrt(square), 1e-15);
    for (var i = begin; i < end; i++) { weights[i] = factor * raw[i]; }
#else
    for (var i = begin; i < end; i++) { weights[i] = update(i, gradient[i]); }
#endif
}
