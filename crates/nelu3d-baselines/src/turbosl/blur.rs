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
pub const HALF: usize = 5;
/// Taps of the kernel.
pub const TAPS: usize = 2 * HALF + 1;

/// What is added to the first moment on the right before it is divided by.
const EPSILON: f32 = 1e-8;

/// A learned kernel of one axis.
#[derive(Clone, Debug)]
pub struct Blur {
    /// The free taps l, then r, from the middle outwards.
    free: [f32; 2 * HALF],
    moments: MomentBuffers,
    n_steps: u64,
}

/// Returns the first moment of taps on one side.
fn moment(taps: &[f32]) -> f32 {
    taps.iter().enumerate().map(|(t, tap)| (t + 1) as f32 * tap).sum()
}

impl Default for Blur {
    fn default() -> Self {
        Self::new()
    }
}

impl Blur {
    /// Returns no blur.
    pub fn new() -> Self {
        Self { free: [0.0; 2 * HALF], moments: MomentBuffers::new(2 * HALF), n_steps: 0 }
    }

    /// Returns a blur of given free taps: those left of the middle, then those right of it, each from the middle
    /// outwards.
    pub fn of(free: [f32; 2 * HALF]) -> Self {
        Self { free, ..Self::new() }
    }

    /// Returns the free taps: those left of the middle, then those right of it, each from the middle outwards.
    pub fn free(&self) -> [f32; 2 * HALF] {
        self.free
    }

    /// Returns the kernel, from the far left to the far right.
    pub fn taps(&self) -> [f32; TAPS] {
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
    pub fn convolve(&self, line: &[f32]) -> Vec<f32> {
        let taps = self.taps();
        (0..line.len()).map(|i| taps.iter().enumerate().map(|(t, tap)| tap * shifted(line, i, t)).sum()).collect()
    }

    /// Adds to `d` the gradient by the free taps, given that by the kernel's ([`Self::taps`]).
    pub fn backward(&self, d_taps: &[f32; TAPS], d: &mut [f32; 2 * HALF]) {
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
pub fn tap_gradient(line: &[f32], d: &[f32]) -> [f32; TAPS] {
    std::array::from_fn(|t| d.iter().enumerate().map(|(i, d)| d * shifted(line, i, t)).sum())
}

/// Returns the value that tap `t` of the kernel sees at pixel `i`; 0 beyond the line.
fn shifted(line: &[f32], i: usize, t: usize) -> f32 {
    (i + t).checked_sub(HALF).and_then(|i| line.get(i)).copied().unwrap_or(0.0)
}

/// Returns the value of a line at `u` px, linear between two pixels; 0 outside the line.
#[inline]
pub fn sample(line: &[f32], u: f32) -> f32 {
    let (i, f) = (u.floor(), u - u.floor());
    let at = |i: f32| if i >= 0.0 && i < line.len() as f32 { line[i as usize] } else { 0.0 };
    (1.0 - f) * at(i) + f * at(i + 1.0)
}

/// Adds to `d_line` the gradient of [`sample`] at `u` px by the line, times `d`.
#[inline]
pub fn sample_backward(d_line: &mut [f32], u: f32, d: f32) {
    let (i, f) = (u.floor(), u - u.floor());
    for (i, w) in [(i, 1.0 - f), (i + 1.0, f)] {
        if i >= 0.0 && i < d_line.len() as f32 {
            d_line[i as usize] += w * d;
        }
    }
}
