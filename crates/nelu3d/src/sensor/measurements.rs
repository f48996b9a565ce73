//! The measurements of a scene: normalized intensities, their variances, and which pixels cannot be used.

use nelu3d_scan::image::box_mean;
use nelu3d_scan::rig::Capture;

use super::dark_level::DarkLevel;
use super::intensities::Intensities;
use super::noise::NoiseModel;
use crate::surface::PixelStatus;

/// Normalized intensities of a scene.
#[derive(Clone, Debug)]
pub struct Measurements {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Width and height of the picture that these are a part of, in pixels.
    pub image: [usize; 2],
    /// Number of pattern channels.
    pub k: usize,
    /// Number of pattern channels that are measured independently: the three of a mono image of a color camera count as
    /// one.
    pub independent: f32,
    /// Normalized intensity, `n × k`: (pattern − black) / (white − black).
    pub p: Vec<f32>,
    /// One over the variance of `p`, `n × k`; 0 where a channel is unusable.
    pub inv_var: Vec<f32>,
    /// Codeword of a pixel's surroundings, `n × k`: that of the light that comes from there (interreflection).
    pub surround: Vec<f32>,
    /// Status of each pixel so far: valid, saturated or underexposed.
    pub status: Vec<PixelStatus>,
    /// Mean white − black over channels.
    pub contrast: Vec<f32>,
    /// White − black of every channel, `n × channels`.
    pub light: Vec<f32>,
    /// True if ambient light was subtracted by means of a black image of the scene itself.
    pub has_black: bool,
}

impl Measurements {
    /// Normalizes a capture. Without a black image, the sweep's dark level replaces it. `model_sigma` is the standard
    /// deviation of the color field itself, which is added to the sensor's noise; `image` the size of the picture that
    /// the capture is a part of, px.
    pub fn new(capture: &Capture, image: [usize; 2], noise: &NoiseModel, dark: &[DarkLevel], model_sigma: f32) -> Self {
        Self::normalized(capture, image, noise, dark, model_sigma, true)
    }

    /// Normalizes a capture as [`Self::new`] does, but for what noise does to means: for values that are compared one by
    /// one with others that were measured alike.
    pub fn as_measured(capture: &Capture, image: [usize; 2], noise: &NoiseModel, dark: &[DarkLevel]) -> Self {
        Self::normalized(capture, image, &NoiseModel { darkest: None, ..*noise }, dark, 0.0, false)
    }

    fn normalized(
        capture: &Capture,
        image: [usize; 2],
        noise: &NoiseModel,
        dark: &[DarkLevel],
        model_sigma: f32,
        unbiased: bool,
    ) -> Self {
        let white = &capture.white;
        let (n, c) = (white.width * white.height, white.channels);
        let k = capture.patterns.len() * c;
        let mut out = Self {
            width: white.width,
            height: white.height,
            image,
            k,
            independent: (k - (c - 1) * capture.mono.iter().filter(|mono| **mono).count()) as f32,
            p: vec![0.0; n * k],
            inv_var: vec![0.0; n * k],
            surround: Vec::new(),
            status: vec![PixelStatus::Valid; n],
            contrast: vec![0.0; n],
            light: vec![0.0; n * c],
            has_black: capture.black.is_some(),
        };
        let black_of_white = |at: usize, w: f32| dark.get(at % c).map_or(0.0, |d| d.at(w));
        let (whites, blacks) = (
            Intensities::new(white, noise),
            match &capture.black {
                Some(black) => Intensities::new(black, noise),
                None => Intensities {
                    own: white.data.iter().enumerate().map(|(at, w)| black_of_white(at, *w)).collect(),
                    mean: Vec::new(),
                },
            },
        );
        for at in 0..n * c {
            out.light[at] = whites.own[at] - blacks.own[at];
            out.contrast[at / c] += out.light[at] / c as f32;
        }
        let (mut usable, mut saturated) = (vec![0u16; n], vec![false; n]);
        for (m, pattern) in capture.patterns.iter().enumerate() {
            let values = Intensities::new(pattern, noise);
            for at in 0..n * c {
                let (i, ch) = (at / c, at % c);
                if white.data[at] >= 1.0 || pattern.data[at] >= 1.0 {
                    saturated[i] = true;
                    continue;
                }
                // What is known of a pixel's noise must not follow it.
                let black = match blacks.mean.get(at) {
                    Some(black) => *black,
                    None => black_of_white(at, whites.mean[at]),
                };
                let (contrast, light) = (out.light[at], whites.mean[at] - black);
                if contrast <= 0.0 || light <= 0.0 || noise.is_underexposed(light, black, out.independent) {
                    continue;
                }
                let l = (values.own[at] - blacks.own[at]) / contrast;
                let typical = ((values.mean[at] - black) / light).clamp(0.0, 1.0);
                let mut var = noise.normalized_variance(typical, light, black) + model_sigma * model_sigma;
                // All channels hold one value: together they weigh as much as one.
                if capture.mono[m] {
                    var *= c as f32;
                }
                let bias = if unbiased { noise.normalized_bias(typical, light, black, out.has_black) } else { 0.0 };
                out.p[i * k + m * c + ch] = l - bias;
                out.inv_var[i * k + m * c + ch] = 1.0 / var;
                usable[i] += 1;
            }
        }
        // A pixel needs most of its channels: with fewer the code is not the one that was calibrated.
        for i in (0..n).filter(|i| usize::from(usable[*i]) * 3 < k * 2) {
            out.status[i] = if saturated[i] { PixelStatus::Saturated } else { PixelStatus::Underexposed };
            out.inv_var[i * k..(i + 1) * k].fill(0.0);
        }
        out.surround = out.surroundings();
        out
    }

    /// Returns the mean codeword around every pixel, weighted by contrast.
    pub(super) fn surroundings(&self) -> Vec<f32> {
        let (n, k) = (self.n(), self.k);
        let radius = (self.image[0].max(self.image[1]) / 24).max(2);
        let mut out = vec![0.0; n * k];
        for j in 0..k {
            let usable = |i: usize| self.inv_var[i * k + j] > 0.0;
            let mut den: Vec<f32> = (0..n).map(|i| if usable(i) { self.contrast[i].max(0.0) } else { 0.0 }).collect();
            let mut num: Vec<f32> = den.iter().enumerate().map(|(i, w)| w * self.p[i * k + j]).collect();
            for _ in 0..2 {
                box_mean(&mut num, self.width, self.height, radius);
                box_mean(&mut den, self.width, self.height, radius);
            }
            for i in 0..n {
                out[i * k + j] = if den[i] > 1e-6 { num[i] / den[i] } else { 0.5 };
            }
        }
        out
    }

    /// Returns the gradient of the logarithm of white − black at pixel `i`, per pixel along x and y, and the variance that
    /// noise gives its square: 0 along an axis where a neighbor is saturated or outside.
    pub(crate) fn log_gradient(&self, i: usize, noise: &NoiseModel) -> ([f32; 2], f32) {
        let (x, y, own) = (i % self.width, i / self.width, self.contrast[i]);
        let channels = (self.light.len() / self.n().max(1)).max(1) as f32;
        let mut variance = 0.0;
        let mut along = |at: usize, end: usize, stride: usize| {
            if at == 0 || at + 1 >= end || own <= 0.0 {
                return 0.0;
            }
            let beside = [i - stride, i + stride];
            if beside.iter().any(|j| self.status[*j] == PixelStatus::Saturated) {
                return 0.0;
            }
            let [before, after] = beside.map(|j| self.contrast[j]);
            let of_noise: f32 = [before, after].iter().map(|c| noise.variance(c.max(0.0))).sum();
            variance += of_noise / (4.0 * channels * own * own);
            (after - before) / (2.0 * own)
        };
        let gradient = [along(x, self.width, 1), along(y, self.height, self.width)];
        (gradient, variance)
    }

    /// Leaves channels out at pixels where the field does not know them: `is_known(pixel, channel)`.
    pub(crate) fn keep_channels(&mut self, is_known: impl Fn(usize, usize) -> bool) {
        for (at, inv_var) in self.inv_var.iter_mut().enumerate() {
            if !is_known(at / self.k, at % self.k) {
                *inv_var = 0.0;
            }
        }
    }

    /// Returns the number of channels of pixel `i` that are measured independently and can be used; at least a
    /// hundredth.
    pub(crate) fn independent_at(&self, i: usize) -> f32 {
        let usable = self.inv_var[i * self.k..(i + 1) * self.k].iter().filter(|v| **v > 0.0).count();
        (self.independent * usable as f32 / self.k as f32).max(0.01)
    }

    /// Returns the number of pixels.
    pub fn n(&self) -> usize {
        self.width * self.height
    }

    /// Returns the means over blocks of `f × f` pixels, weighted by inverse variance, as measurements of a reduced
    /// image.
    pub fn reduced(&self, f: usize) -> Self {
        if f == 1 {
            return self.clone();
        }
        self.reduced_of(f, |i| self.status[i] == PixelStatus::Valid)
    }

    /// Returns the means like [`Self::reduced`], of those pixels that are `usable`, whatever their status.
    pub(crate) fn reduced_of(&self, f: usize, usable: impl Fn(usize) -> bool) -> Self {
        let (w, h, k) = (self.width / f, self.height / f, self.k);
        let channels = self.light.len() / self.n().max(1);
        let mut out = Self {
            width: w,
            height: h,
            image: self.image.map(|n| n / f),
            k,
            independent: self.independent,
            p: vec![0.0; w * h * k],
            inv_var: vec![0.0; w * h * k],
            surround: Vec::new(),
            status: vec![PixelStatus::Underexposed; w * h],
            contrast: vec![0.0; w * h],
            light: vec![0.0; w * h * channels],
            has_black: self.has_black,
        };
        for y in 0..h {
            for x in 0..w {
                let o = y * w + x;
                let mut n_valid = 0;
                for dy in 0..f {
                    for dx in 0..f {
                        let i = (y * f + dy) * self.width + x * f + dx;
                        if !usable(i) {
                            continue;
                        }
                        n_valid += 1;
                        out.contrast[o] += self.contrast[i];
                        for c in 0..channels {
                            out.light[o * channels + c] += self.light[i * channels + c];
                        }
                        for j in 0..k {
                            let iv = self.inv_var[i * k + j];
                            out.p[o * k + j] += iv * self.p[i * k + j];
                            out.inv_var[o * k + j] += iv;
                        }
                    }
                }
                if n_valid > 0 {
                    out.status[o] = PixelStatus::Valid;
                    out.contrast[o] /= n_valid as f32;
                    out.light[o * channels..(o + 1) * channels].iter_mut().for_each(|v| *v /= n_valid as f32);
                    for j in 0..k {
                        let iv = out.inv_var[o * k + j];
                        out.p[o * k + j] = if iv > 0.0 { out.p[o * k + j] / iv } else { 0.0 };
                    }
                }
            }
        }
        out.surround = out.surroundings();
        out
    }
}
