//! How the light falls off over the image.

use nalgebra::{SMatrix, SVector};

use super::pixels::Pixels;
use crate::statistics::median;

/// The logarithm of the light as a quadratic in pixel coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    center: [f64; 2],
    scale: f64,
    /// Coefficients of x, y, x², xy and y², in units of `scale` from `center`.
    coeffs: [f64; 5],
}

impl Light {
    /// Fits the light to levels of white paper (pixel and level); it is even where they are too few. Two rounds: levels
    /// off by far more than most (a shadow, a highlight) do not count in the second.
    pub(super) fn fit(image: &Pixels, levels: &[([f64; 2], f64)]) -> Self {
        let center = [0.5 * image.width as f64, 0.5 * image.height as f64];
        let scale = center[0].max(center[1]);
        let mut light = Self { center, scale, coeffs: [0.0; 5] };
        let mut keep: Vec<(SVector<f64, 6>, f64)> = levels
            .iter()
            .filter(|l| l.1 > 0.0)
            .map(|(p, level)| {
                let [x, y] = light.local(*p);
                (SVector::<f64, 6>::from([x, y, x * x, x * y, y * y, 1.0]), level.ln())
            })
            .collect();
        for round in 0..2 {
            if keep.len() < 24 {
                break;
            }
            let (mut a, mut g) = (SMatrix::<f64, 6, 6>::identity() * 1e-6, SVector::<f64, 6>::zeros());
            for (row, value) in &keep {
                a += row * row.transpose();
                g += row * *value;
            }
            let Some(c) = a.cholesky().map(|c| c.solve(&g)) else { break };
            light.coeffs = std::array::from_fn(|i| c[i]);
            if round == 0 {
                let off = |k: &(SVector<f64, 6>, f64)| (k.1 - k.0.dot(&c)).abs();
                let mut distances: Vec<f64> = keep.iter().map(off).collect();
                let limit = 5.0 * median(&mut distances).unwrap_or(0.0) + 1e-9;
                keep.retain(|k| off(k) <= limit);
            }
        }
        light
    }

    /// Returns the relative change per pixel along x and y.
    pub(super) fn slope(&self, px: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.local(px);
        let [a, b, xx, xy, yy] = self.coeffs;
        [(a + 2.0 * xx * x + xy * y) / self.scale, (b + xy * x + 2.0 * yy * y) / self.scale]
    }

    fn local(&self, px: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|k| (px[k] - self.center[k]) / self.scale)
    }
}
