// One level of the multiresolution hash grid: see encoding/hash_grid/mod.rs. DIM, FEATURES.

struct Level {
    resolution: vec3<u32>,
    // First entry in the table.
    offset: u32,
    factors: vec3<u32>,
    // Bricks - 1 of a hashed level; 0 for a dense one.
    mask: u32,
}

struct Cell {
    corner: vec3<u32>,
    fraction: vec3<f32>,
}

fn locate(level: Level, p: vec3<f32>) -> Cell {
    let n = vec3<f32>(level.resolution);
    let position = clamp(p, vec3(0.0), vec3(1.0)) * n;
    let low = min(floor(position), n - 1.0);
    return Cell(vec3<u32>(low), position - low);
}

// Index of a corner's first feature in the table.
fn entry(level: Level, cell: Cell, corner: u32) -> u32 {
    let vertex = cell.corner + (vec3(corner, corner >> 1u, corner >> 2u) & vec3(1u));
    let along = (vertex >> vec3(1u)) * level.factors;
    var brick = along.x + along.y + along.z;
    if (level.mask != 0u) { brick = (along.x ^ along.y ^ along.z) & level.mask; }
    let bits = vertex & vec3(1u);
    let within = bits.x | (bits.y << 1u) | (bits.z << 2u);
    return (level.offset + ((brick << DIM) | within)) * FEATURES;
}

// Weights of a corner along each axis.
fn along(cell: Cell, corner: u32) -> vec3<f32> {
    let upper = (vec3(corner, corner >> 1u, corner >> 2u) & vec3(1u)) == vec3(1u);
    return select(1.0 - cell.fraction, cell.fraction, upper);
}

// Derivative of a corner's weight by the point; zero along axes on which the point is clamped.
fn slope(level: Level, cell: Cell, corner: u32, p: vec3<f32>) -> vec3<f32> {
    let w = along(cell, corner);
    let upper = (vec3(corner, corner >> 1u, corner >> 2u) & vec3(1u)) == vec3(1u);
    let inside = (p >= vec3(0.0)) & (p <= vec3(1.0));
    let sign = select(vec3(-1.0), vec3(1.0), upper) * select(vec3(0.0), vec3(1.0), inside);
    return sign * vec3<f32>(level.resolution) * vec3(w.y * w.z, w.x * w.z, w.x * w.y);
}
