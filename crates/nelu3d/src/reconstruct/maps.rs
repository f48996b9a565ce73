//! Operations on per-pixel maps that several stages need.

use std::collections::VecDeque;

use rayon::prelude::*;

use crate::surface::PixelStatus;

/// Interpolates a `height × width` map at (x, y), px, where the four values around it differ by at most
/// `max_difference`; elsewhere returns the nearest value.
pub(crate) fn interpolate_within(map: &[f32], width: usize, height: usize, x: f32, y: f32, max_difference: f32) -> f32 {
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let four = [map[y0 * width + x0], map[y0 * width + x1], map[y1 * width + x0], map[y1 * width + x1]];
    let (lo, hi) = four.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    if four.iter().all(|v| v.is_finite()) && hi - lo <= max_difference {
        return (four[0] * (1.0 - fx) + four[1] * fx) * (1.0 - fy) + (four[2] * (1.0 - fx) + four[3] * fx) * fy;
    }
    four[usize::from(fx > 0.5) + 2 * usize::from(fy > 0.5)]
}

/// Fills valid pixels without a value (NaN) from their nearest neighbors that have one, connected through valid pixels.
pub(crate) fn fill_from_neighbors(values: &mut [f32], status: &[PixelStatus], width: usize) {
    let mut queue: VecDeque<usize> = (0..values.len()).filter(|i| values[*i].is_finite()).collect();
    while let Some(i) = queue.pop_front() {
        let x = i % width;
        let around = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then_some(i + 1),
            i.checked_sub(width),
            (i + width < values.len()).then_some(i + width),
        ];
        for j in around.into_iter().flatten() {
            if status[j] == PixelStatus::Valid && values[j].is_nan() {
                values[j] = values[i];
                queue.push_back(j);
            }
        }
    }
}

/// Returns the mean over the finite values in a square of `2 radius + 1` pixels around each finite pixel; NaN
/// elsewhere.
pub(crate) fn local_mean(v: &[f32], width: usize, height: usize, radius: usize) -> Vec<f32> {
    (0..v.len())
        .into_par_iter()
        .map(|i| {
            if !v[i].is_finite() {
                return f32::NAN;
            }
            let (x, y) = (i % width, i / width);
            let (mut sum, mut n) = (0.0, 0);
            for yy in y.saturating_sub(radius)..(y + radius + 1).min(height) {
                for xx in x.saturating_sub(radius)..(x + radius + 1).min(width) {
                    let u = v[yy * width + xx];
                    if u.is_finite() {
                        sum += u;
                        n += 1;
                    }
                }
            }
            sum / n as f32
        })
        .collect()
}
