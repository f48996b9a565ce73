//! The projector's blur: a separable kernel of 11 × 11 projector pixels, learned.
//!
//! Each axis has five free taps l_t on the left and r_t on the right, t pixels away. Those on the right are rescaled so
//! that the kernel does not move the pattern, and the middle makes the sum 1:
//!
//! ```text
//! r'_t = r_t Σ s l_s / (Σ s r_s + 1e-8),     middle = 1 − Σ l_t − Σ r'_t
//! ```
//!
//! There is no light beyond the image, and what is blurred is clipped to [0, 1]. All taps begin at 0.

use std::io::{self, Read, Write};

use nelu3d_field::adam::{self, AdamConfig, MomentBuffers, Schedule};
use nelu3d_field::state::{TrainingState, read_floats, read_u64, write_floats, write_u64};

/// Free taps on either side.
pub(crate) const HALF: usize = 5;
/// Taps of the kernel.
pub(crate) const TAPS: usize = 2 * HALF + 1;

/// What is added to the first moment on the right before it is divided by.
const EPSILON: f32 = 1e-8;

/// A learned kernel of one axis.
#[derive(Clone, Debug)]
pub(crate) struct Blur {
    /// The free taps l, then r, from the middle outwards.
    free: [f32; 2 * HALF],
    moments: MomentBuffers,
    n_steps: u64,
}

/// Returns the first moment of taps on one side.
fn moment(taps: &[f32]) -> f32 {
    taps.iter().enumerate().map(|(t, tap)| (t + 1) as f32 * tap).sum()
}

impl Blur {
    /// No blur.
    pub(crate) fn new() -> Self {
        Self { free: [0.0; 2 * HALF], moments: MomentBuffers::new(2 * HALF), n_steps: 0 }
    }

    /// A blur of given free taps.
    #[cfg(test)]
    pub(crate) fn of(free: [f32; 2 * HALF]) -> Self {
        Self { free, ..Self::new() }
    }

    /// Returns the free taps of a blur: those left of the middle, then those right of it.
    #[cfg(test)]
    pub(crate) fn free(&self) -> [f32; 2 * HALF] {
        self.free
    }

    /// Returns the kernel, from the far left to the far right.
    pub(crate) fn taps(&self) -> [f32; TAPS] {
        let (left, right) = self.free.split_at(HALF);
        let balance = moment(left) / (moment(right) + EPSILON);
        let mut taps = [0.0; TAPS];
        for t in 0..HALF {
            taps[HALF - 1 - t] = left[t];
            taps[HALF + 1 + t] = right[t] * balance;
        }
        taps[HALF] = 1.0 - taps.iter().sum::<f32>();
        taps
    }

    /// Returns a blurred line of values, before it is clipped to [0, 1].
    pub(crate) fn convolve(&self, line: &[f32]) -> Vec<f32> {
        let taps = self.taps();
        (0..line.len()).map(|i| taps.iter().enumerate().map(|(t, tap)| tap * shifted(line, i, t)).sum()).collect()
    }

    /// Adds to `d` the gradient by the free taps, given that by the kernel's ([`Self::taps`]).
    pub(crate) fn backward(&self, d_taps: &[f32; TAPS], d: &mut [f32; 2 * HALF]) {
        let d_middle = d_taps[HALF];
        let (left, right) = self.free.split_at(HALF);
        let below = moment(right) + EPSILON;
        let balance = moment(left) / below;
        // By the rescaled taps on the right, and by what rescales them.
        let d_right: [f32; HALF] = std::array::from_fn(|t| d_taps[HALF + 1 + t] - d_middle);
        let d_balance: f32 = right.iter().zip(d_right).map(|(r, d)| r * d).sum();
        for t in 0..HALF {
            let distance = (t + 1) as f32;
            d[t] += d_taps[HALF - 1 - t] - d_middle + d_balance * distance / below;
            d[HALF + t] += d_right[t] * balance - d_balance * distance * balance / below;
        }
    }

    /// One step of the optimizer.
    pub(crate) fn descend(&mut self, d: &[f32; 2 * HALF], learning_rate: f64, adam: &AdamConfig, schedule: &Schedule) {
        let rate = learning_rate * schedule.factor(self.n_steps);
        adam::cpu::step(adam, rate, self.n_steps, &mut self.free, self.moments.all(), d);
        self.n_steps += 1;
    }
}

impl TrainingState for Blur {
    fn save(&self, out: &mut dyn Write) -> io::Result<()> {
        write_floats(out, &self.free)?;
        write_floats(out, &self.moments.first)?;
        write_floats(out, &self.moments.second)?;
        write_u64(out, self.n_steps)
    }

    fn load(&mut self, from: &mut dyn Read) -> io::Result<()> {
        read_floats(from, &mut self.free)?;
        read_floats(from, &mut self.moments.first)?;
        read_floats(from, &mut self.moments.second)?;
        self.n_steps = read_u64(from)?;
        Ok(())
    }
}

/// Returns the gradient by the kernel of a line's convolution, given that by the convolved line.
pub(crate) fn tap_gradient(line: &[f32], d: &[f32]) -> [f32; TAPS] {
    std::array::from_fn(|t| d.iter().enumerate().map(|(i, d)| d * shifted(line, i, t)).sum())
}

/// Returns the value that tap `t` of the kernel sees at pixel `i`; 0 beyond the line.
fn shifted(line: &[f32], i: usize, t: usize) -> f32 {
    (i + t).checked_sub(HALF).and_then(|i| line.get(i)).copied().unwrap_or(0.0)
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
        let blur = Blur::of;
        let mut line = vec![0.0f32; 41];
        line[20] = 1.0;
        let free = [0.2, 0.1, 0.04, 0.0, 0.01, 0.1, 0.02, 0.03, 0.01, 0.0];
        let kernel = blur(free).taps();
        let out = blur(free).convolve(&line);
        let sum: f32 = out.iter().sum();
        let mean: f32 = out.iter().enumerate().map(|(i, v)| i as f32 * v).sum();
        assert!((sum - 1.0).abs() < 1e-6 && (mean - 20.0).abs() < 1e-5);
        // The two sides differ.
        assert!((kernel[HALF - 1] - 0.2).abs() < 1e-6 && (kernel[HALF + 1] - 0.2).abs() > 0.01, "{kernel:?}");
        assert_eq!(Blur::new().convolve(&line), line);
        // d of Σ s_i blurred_i by the free taps.
        let line: Vec<f32> = (0..41).map(|i| 0.5 + 0.7 * (i as f32 * 0.7).sin()).collect();
        let s: Vec<f32> = (0..41).map(|i| (i as f32 * 0.3).cos()).collect();
        let mut d = [0.0; 2 * HALF];
        blur(free).backward(&tap_gradient(&line, &s), &mut d);
        let value = |free: [f32; 2 * HALF]| -> f64 {
            blur(free).convolve(&line).iter().zip(&s).map(|(a, b)| f64::from(a * b)).sum()
        };
        for t in 0..2 * HALF {
            let at = |e: f32| {
                let mut free = free;
                free[t] += e;
                value(free)
            };
            let expected = (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((f64::from(d[t]) - expected).abs() < 0.02 * expected.abs().max(1.0), "{t}: {} {expected}", d[t]);
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
