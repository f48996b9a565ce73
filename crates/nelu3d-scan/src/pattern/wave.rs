//! One sinusoid: what an image of a phase-shifting set shows.

use std::f64::consts::TAU;

use nalgebra::{Matrix4, Vector4};

/// `½ + ½ cos 2π(u / period_px − shift)` at column u.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Length of a period, px.
    pub period_px: f64,
    /// Shift, in periods.
    pub shift: f64,
}

/// A wave found in an image's line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedWave {
    /// The wave; its shift lies in `[0, 1)`.
    pub wave: Wave,
    /// Half the difference of its extremes.
    pub amplitude: f64,
    /// Its mean.
    pub offset: f64,
    /// Root mean square difference of the line and the wave.
    pub rms: f64,
}

impl Wave {
    /// Returns the value at column `u`.
    pub fn value(&self, u: f64) -> f64 {
        0.5 + 0.5 * (TAU * (u / self.period_px - self.shift)).cos()
    }

    /// Fits the sinusoid that explains a line of an image best, in the sense of least squares: for projected images
    /// whose settings are not known. Whether the line *is* a sinusoid is told by [`FittedWave::rms`], and by
    /// [`FittedWave::amplitude`]: a ramp is a small part of a wave far higher than ½.
    ///
    /// `None` if the line is shorter than 8 px, constant, or holds a value that is not finite.
    pub fn fit(line: &[f32]) -> Option<FittedWave> {
        let n = line.len();
        if n < 8 || line.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let values: Vec<f64> = line.iter().map(|&v| f64::from(v)).collect();
        let (min, max) = values.iter().fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
        if max - min < 1e-6 {
            return None;
        }
        // The best frequency of a grid finer than the peak's width, then Gauss-Newton.
        let step = 0.2 / n as f64;
        let best = (2..=(0.5 / step) as usize)
            .map(|i| i as f64 * step)
            .map(|f| (Linear::solve(&values, f).map_or(f64::MAX, |l| l.sum_of_squares), f))
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        let mut f = best.1;
        for _ in 0..20 {
            let l = Linear::solve(&values, f)?;
            let change = l.frequency_step(&values, f)?.clamp(-step, step);
            f = (f + change).clamp(0.2 * step, 0.5);
            if change.abs() < 1e-14 {
                break;
            }
        }
        let l = Linear::solve(&values, f)?;
        let wave = Wave { period_px: 1.0 / f, shift: (l.sin.atan2(l.cos) / TAU).rem_euclid(1.0) };
        let rms = (l.sum_of_squares / n as f64).sqrt();
        Some(FittedWave { wave, amplitude: l.cos.hypot(l.sin), offset: l.offset, rms })
    }
}

/// `offset + cos · cos(2πfu) + sin · sin(2πfu)`, fitted to a line.
struct Linear {
    offset: f64,
    cos: f64,
    sin: f64,
    sum_of_squares: f64,
}

impl Linear {
    fn solve(values: &[f64], f: f64) -> Option<Self> {
        let mut a = nalgebra::Matrix3::zeros();
        let mut b = nalgebra::Vector3::zeros();
        let mut squares = 0.0;
        for_each(values, f, |_, c, s, v| {
            let row = nalgebra::Vector3::new(1.0, c, s);
            a += row * row.transpose();
            b += row * v;
            squares += v * v;
        });
        // Half a wave per pixel has no sine at the pixels: its share is nothing, not everything.
        a[(2, 2)] += 1e-9 * values.len() as f64;
        let x = a.cholesky()?.solve(&b);
        Some(Self { offset: x[0], cos: x[1], sin: x[2], sum_of_squares: (squares - x.dot(&b)).max(0.0) })
    }

    /// Returns the Gauss-Newton step of the frequency, the other parameters free.
    fn frequency_step(&self, values: &[f64], f: f64) -> Option<f64> {
        let mut a = Matrix4::zeros();
        let mut b = Vector4::zeros();
        for_each(values, f, |u, c, s, v| {
            let row = Vector4::new(1.0, c, s, TAU * u * (self.sin * c - self.cos * s));
            a += row * row.transpose();
            b += row * (v - self.offset - self.cos * c - self.sin * s);
        });
        Some(a.lu().solve(&b)?[3])
    }
}

/// Calls `f` with every column, cosine, sine and value; the wave turns by multiplication, which is fast.
fn for_each(values: &[f64], frequency: f64, mut f: impl FnMut(f64, f64, f64, f64)) {
    let (ts, tc) = (TAU * frequency).sin_cos();
    let (mut s, mut c) = (0.0, 1.0);
    for (u, &v) in values.iter().enumerate() {
        f(u as f64, c, s, v);
        (c, s) = (c * tc - s * ts, s * tc + c * ts);
    }
}
