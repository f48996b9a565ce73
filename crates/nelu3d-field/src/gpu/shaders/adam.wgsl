// One step of Adam: see adam/mod.rs. BETA1, BETA2, EPSILON; rates[RATES_AT + 2] is the root.

fn adam(p: f32, m: ptr<function, f32>, v: ptr<function, f32>, g: f32, rate: f32, root: f32) -> f32 {
    *m += (1.0 - BETA1) * (g - *m);
    *v += (1.0 - BETA2) * (g * g - *v);
    return p - rate * *m / (sqrt(*v) * root + EPSILON);
}
