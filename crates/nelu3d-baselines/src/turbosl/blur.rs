//! The projector's blur: a separable kernel of 11 × 11 projector pixels, learned.
//!
//! Each axis has five free taps, the same on both sides, and a middle that makes the sum 1: the kernel neither moves
//! the pattern (which the published kernel sees to by balancing its two halves) nor changes its brightness.

use nelu3d_field::adam::{self, AdamConfig, MomentBuffers, Schedule};

/// Taps on either side.
pub(crate) const HALF: usize = 5;

/// A learned kernel of one axis.
#[derive(Clone, Debug)]
pub(crate) struct Blur {
    taps: [f32; HALF],
    moments: MomentBuffers,
    n_steps: u64,
}

impl Blur {
    /// No blur.
    pub(crate) fn new() -> Self {
        Self { taps: [0.0; HALF], moments: MomentBuffers::new(HALF), n_steps: 0 }
    }

    /// Returns the taps on one side, from the middle outwards.
    pub(crate) fn taps(&self) -> [f32; HALF] {
        self.taps
    }

    /// Returns a blurred line; beyond its ends there is no light.
    pub(crate) fn apply(&self, line: &[f32]) -> Vec<f32> {
        let middle = 1.0 - 2.0 * self.taps.iter().sum::<f32>();
        (0..line.len())
            .map(|i| {
                let sides = self.taps.iter().enumerate().map(|(t, tap)| tap * both(line, i, t + 1));
                middle * line[i] + sides.sum::<f32>()
            })
            .collect()
    }

    /// Adds to `d` the gradient by the taps, given that by the blurred line.
    pub(crate) fn backward(line: &[f32], d_blurred: &[f32], d: &mut [f32; HALF]) {
        for (t, d) in d.iter_mut().enumerate() {
            *d += d_blurred.iter().enumerate().map(|(i, d)| d * (both(line, i, t + 1) - 2.0 * line[i])).sum::<f32>();
        }
    }

    /// One step of the optimizer.
    pub(crate) fn descend(&mut self, d: &[f32; HALF], learning_rate: f64, adam: &AdamConfig, schedule: &Schedule) {
        let rate = learning_rate * schedule.factor(self.n_steps);
        adam::cpu::step(adam, rate, self.n_steps, &mut self.taps, self.moments.all(), d);
        self.n_steps += 1;
    }
}

/// Returns the sum of the two values `t` away.
fn both(line: &[f32], i: usize, t: usize) -> f32 {
    let left = i.checked_sub(t).map_or(0.0, |i| line[i]);
    left + line.get(i + t).copied().unwrap_or(0.0)
}

/// Returns a value between two pixels, linear; 0 outside the line.
#[inline]
pub(crate) fn sample(line: &[f32], u: f32) -> f32 {
    let (i, f) = (u.floor(), u - u.floor());
    let at = |i: f32| if i >= 0.0 && i < line.len() as f32 { line[i as usize] } else { 0.0 };
    (1.0 - f) * at(i) + f * at(i + 1.0)
}

/// Adds the gradient of [`sample`] by the line.
#[inline]
pub(crate) fn sample_backward(d_line: &mut [f32], u: f32, d: f32) {
    let (i, f) = (u.floor(), u - u.floor());
    for (i, w) in [(i, 1.0 - f), (i + 1.0, f)] {
        if i >= 0.0 && i < d_line.len() as f32 {
            d_line[i as usize] += w * d;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_place_and_brightness_and_differentiates() {
        let mut line = vec![0.0f32; 41];
        line[20] = 1.0;
        let blur = Blur { taps: [0.2, 0.1, 0.04, 0.0, 0.01], ..Blur::new() };
        let out = blur.apply(&line);
        let sum: f32 = out.iter().sum();
        let mean: f32 = out.iter().enumerate().map(|(i, v)| i as f32 * v).sum();
        assert!((sum - 1.0).abs() < 1e-6 && (mean - 20.0).abs() < 1e-5);
        assert_eq!(Blur::new().apply(&line), line);
        // d of Σ s_i blurred_i by the taps.
        let line: Vec<f32> = (0..41).map(|i| (i as f32 * 0.7).sin()).collect();
        let s: Vec<f32> = (0..41).map(|i| (i as f32 * 0.3).cos()).collect();
        let mut d = [0.0; HALF];
        Blur::backward(&line, &s, &mut d);
        let value = |taps: [f32; HALF]| -> f64 {
            let out = Blur { taps, ..Blur::new() }.apply(&line);
            out.iter().zip(&s).map(|(a, b)| f64::from(a * b)).sum()
        };
        for t in 0..HALF {
            let mut taps = [0.1; HALF];
            taps[t] = 0.2;
            let expected = (value(taps) - value([0.1; HALF])) / 0.1;
            assert!((f64::from(d[t]) - expected).abs() < 1e-3, "{t}: {} {expected}", d[t]);
        }
    }

    #[test]
    fn samples_between_pixels() {
        let line = [1.0, 3.0, 5.0];
        assert_eq!(
            [sample(&line, 0.5), sample(&line, 2.0), sample(&line, -0.5), sample(&line, 7.0)],
            [2.0, 5.0, 0.5, 0.0]
        );
        let mut d = [0.0; 3];
        sample_backward(&mut d, 1.25, 4.0);
        sample_backward(&mut d, -3.0, 4.0);
        assert_eq!(d, [0.0, 3.0, 1.0]);
    }
}
