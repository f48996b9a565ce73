//! How badly a codeword of the lattice explains a measured one.

/// Normal equations of the two light fractions, a of ambient light and b of interreflection, in
/// `p − c = a (1 − c) + b (surround − c)`.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightFractionEquations {
    /// Entries aa, ab, bb of the matrix, then the right-hand side.
    pub sums: [f32; 5],
}

impl LightFractionEquations {
    /// Adds a measurement: residual `r` = a · `ambient` + b · `indirect`, with weight `iv`.
    #[inline(always)]
    pub fn add(&mut self, r: f32, ambient: f32, indirect: f32, iv: f32) {
        self.sums[0] += iv * ambient * ambient;
        self.sums[1] += iv * ambient * indirect;
        self.sums[2] += iv * indirect * indirect;
        self.sums[3] += iv * ambient * r;
        self.sums[4] += iv * indirect * r;
    }

    /// Returns the best fractions, neither negative nor above 0.45, and by how much they lower χ². `prior` are the
    /// weights of their squares.
    #[inline(always)]
    pub fn solve(&self, prior: [f32; 2]) -> ([f32; 2], f32) {
        let [aa, ab, bb, f, g] = self.sums;
        let (a, c) = (aa + prior[0], bb + prior[1]);
        let det = a * c - ab * ab;
        let mut x = [(c * f - ab * g) / det, (a * g - ab * f) / det];
        if x[0] < 0.0 {
            x = [0.0, (g / c).max(0.0)];
        } else if x[1] < 0.0 {
            x = [(f / a).max(0.0), 0.0];
        }
        x = x.map(|v| v.min(0.45));
        let gain = 2.0 * (x[0] * f + x[1] * g) - a * x[0] * x[0] - c * x[1] * x[1] - 2.0 * ab * x[0] * x[1];
        (x, gain)
    }
}

/// Returns the misfit (χ²) of a pixel at a point with codeword `c`, after the best light fractions, saturating for
/// outliers. `p`, `inv_var` and `surround` are those of the pixel, k values each; see [`super::Problem`].
#[inline(always)]
pub fn misfit([p, inv_var, surround]: [&[f32]; 3], c: &[f32], prior: [f32; 2], saturation: f32) -> f32 {
    let (mut fractions, mut e) = (LightFractionEquations::default(), 0.0);
    for (j, c) in c.iter().enumerate() {
        let (r, iv) = (p[j] - c, inv_var[j]);
        fractions.add(r, 1.0 - c, surround[j] - c, iv);
        e += iv * r * r;
    }
    let e = (e - fractions.solve(prior).1).max(0.0);
    e / (1.0 + e / saturation)
}
