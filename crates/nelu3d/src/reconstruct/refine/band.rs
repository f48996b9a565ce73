//! Quadrature of volume rendering across the surface.

use nelu3d_field::volrend::reference::render_weights;

/// Returns the quadrature across the narrow band: offsets along f in units of the width, and their weights. The NeuS
/// weights of a planar surface are a logistic density of width 1/inv_s, here cut off at four widths. Three samples
/// integrate any polynomial up to degree 5 against it exactly (Gauss), and over a band this narrow a spline nearly is
/// one.
pub fn quadrature() -> [(f32, f32); 3] {
    let bounds: Vec<f64> = (0..=64).map(|j| 4.0 - 8.0 * f64::from(j) / 64.0).collect();
    let mut weights = vec![0.0; bounds.len()];
    render_weights(&bounds, 1.0, &mut weights);
    let total: f64 = weights.iter().sum();
    let moment = |power: i32| -> f64 {
        bounds.windows(2).zip(&weights).map(|(b, w)| w * (0.5 * (b[0] + b[1])).powi(power)).sum::<f64>() / total
    };
    // The density is symmetric: nodes 0 and ±√(m4 / m2).
    let (m2, m4) = (moment(2), moment(4));
    let (node, side) = ((m4 / m2).sqrt() as f32, (0.5 * m2 * m2 / m4) as f32);
    [(-node, side), (0.0, 1.0 - 2.0 * side), (node, side)]
}
