//! Values between pixels.

/// Interpolates a map of `width × height` values bilinearly at (x, y), px; pixel centers lie at whole numbers. Outside of
/// the map the value is that of its border.
pub fn bilinear(map: &[f32], [width, height]: [usize; 2], [x, y]: [f64; 2]) -> f32 {
    let (x, y) = (x.clamp(0.0, width as f64 - 1.0), y.clamp(0.0, height as f64 - 1.0));
    let (x0, y0) = ((x as usize).min(width.saturating_sub(2)), (y as usize).min(height.saturating_sub(2)));
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let row = |y: usize| map[y * width + x0] * (1.0 - fx) + map[y * width + x1] * fx;
    row(y0) * (1.0 - fy) + row(y1) * fy
}
