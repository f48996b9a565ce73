// Uniform numbers in [0, 1) without a state: PCG (O'Neill 2014) over what names them (Jarzynski & Olano 2020, pcg3d).

fn random(a: u32, b: u32, c: u32) -> vec3<f32> {
    var v = vec3(a, b, c) * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3(16u);
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return vec3<f32>(v >> vec3(8u)) * (1.0 / 16777216.0);
}
