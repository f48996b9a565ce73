//! The blur of a projected line.

/// Returns a line blurred by a Gaussian of standard deviation `sigma` px; beyond its ends it goes on with the last
/// value.
pub(super) fn blurred(line: &[f32], sigma: f32) -> Vec<f32> {
    if sigma < 0.05 {
        return line.to_vec();
    }
    let radius = (3.0 * sigma).ceil() as isize;
    let kernel: Vec<f32> = (-radius..=radius).map(|i| (-(i * i) as f32 / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    let last = line.len() as isize - 1;
    (0..=last)
        .map(|u| {
            let tap = |(k, w): (usize, &f32)| w * line[(u + k as isize - radius).clamp(0, last) as usize];
            kernel.iter().enumerate().map(tap).sum::<f32>() / sum
        })
        .collect()
}
