//! The captures of a scene, normalized by white and black, one plane per image and channel.
//!
//! The method itself normalizes pixel by pixel ([`nelu3d::sensor::Measurements`]); decoders go image by image, so their
//! layout is planar. What is underexposed, the noise and the quantization step are those of [`nelu3d::sensor`].

use nelu3d_scan::rig::{Need, PatternSet, RigError, Shot};
use nelu3d_scan::{Image, Rig};
use rayon::prelude::*;

use nelu3d::sensor::{NoiseModel, estimate_scene_noise, quantization_step};
use nelu3d::surface::PixelStatus;

/// The images of a scene, linear.
pub(crate) struct Images {
    pub(super) white: Image,
    pub(super) black: Option<Image>,
    pub(super) patterns: Vec<Image>,
    pub(super) inverse: Vec<Image>,
}

impl Images {
    /// Reads a scene, with the inverse images of the set.
    pub(crate) fn read(rig: &Rig, shot: &Shot, set: &PatternSet) -> Result<Self, RigError> {
        let (capture, inverse) = rayon::join(|| rig.read_shot(shot, set, Need::Scene), || rig.read_inverse(shot, set));
        let capture = capture?;
        Ok(Self { white: capture.white, black: capture.black, patterns: capture.patterns, inverse: inverse? })
    }

    /// Reads a board position: it must have a black image.
    pub(crate) fn read_position(rig: &Rig, shot: &Shot, set: &PatternSet) -> Result<Self, RigError> {
        let capture = rig.read_shot(shot, set, Need::Calibration)?;
        let inverse = rig.read_inverse(shot, set)?;
        Ok(Self { white: capture.white, black: capture.black, patterns: capture.patterns, inverse })
    }
}

/// One image, or one channel of one.
#[derive(Clone, Debug)]
pub(crate) struct Plane {
    /// Place in the pattern set.
    pub(super) image: usize,
    /// Camera channel.
    pub(super) channel: usize,
    /// (pattern − black) / (white − black), one a pixel; meaningless where a pixel is rejected.
    pub(super) p: Vec<f32>,
    /// The normalized inverse image; empty when there is none.
    pub(super) inverse: Vec<f32>,
}

/// Normalized captures.
pub(crate) struct Captured {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Channels of the camera.
    pub(super) channels: usize,
    /// One per image and channel, in the set's order, channels within images.
    pub(super) planes: Vec<Plane>,
    /// White − black, mean over channels.
    pub(super) contrast: Vec<f32>,
    /// Black, mean over channels.
    pub(super) black: Vec<f32>,
    pub(super) noise: NoiseModel,
    /// Which pixels are underexposed or saturated.
    pub(super) status: Vec<PixelStatus>,
    pub(super) has_black: bool,
}

/// Pixels that are worked on together: their values in all images fit the cache.
const CHUNK: usize = 4096;

impl Captured {
    /// Normalizes the images of a scene. Without a black image, there is taken to be no ambient light.
    pub(crate) fn new(images: &Images, rig: &Rig, min_contrast: f32) -> Self {
        let white = &images.white;
        let (n, c) = (white.width * white.height, white.channels);
        let step = quantization_step(rig.black_level, rig.saturation);
        let noise = estimate_scene_noise(white, &images.patterns, step);
        let none = if images.black.is_none() { vec![0.0; n * c] } else { Vec::new() };
        let dark: &[f32] = images.black.as_ref().map_or(&none, |b| &b.data);
        let mut scale = vec![0.0; n * c];
        scale.par_iter_mut().zip(&white.data).zip(dark).for_each(|((s, w), b)| *s = 1.0 / (w - b).max(1e-4));
        let mean = |f: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
            (0..n).into_par_iter().map(|i| (i * c..(i + 1) * c).map(f).sum::<f32>() / c as f32).collect()
        };
        let black = mean(&|j| dark[j]);
        let contrast = mean(&|j| white.data[j] - dark[j]);
        let plane = |image: &Image, ch: usize| -> Vec<f32> {
            let mut out = vec![0.0; n];
            out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
                let at = chunk * CHUNK * c;
                let (image, dark, scale) = (&image.data[at..], &dark[at..], &scale[at..]);
                if c == 1 {
                    for (((o, v), b), s) in out.iter_mut().zip(image).zip(dark).zip(scale) {
                        *o = (v - b) * s;
                    }
                } else {
                    for (i, o) in out.iter_mut().enumerate() {
                        let j = i * c + ch;
                        *o = (image[j] - dark[j]) * scale[j];
                    }
                }
            });
            out
        };
        let planes = (0..images.patterns.len())
            .flat_map(|image| (0..c).map(move |channel| (image, channel)))
            .map(|(image, channel)| Plane {
                image,
                channel,
                p: plane(&images.patterns[image], channel),
                inverse: images.inverse.get(image).map_or_else(Vec::new, |inverse| plane(inverse, channel)),
            })
            .collect();
        // The brightest value of a pixel in any image and channel.
        let mut brightest = vec![f32::NEG_INFINITY; n];
        brightest.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            for image in [white].into_iter().chain(&images.patterns).chain(&images.inverse) {
                for ch in 0..c {
                    let values = image.data[chunk * CHUNK * c + ch..].iter().step_by(c);
                    out.iter_mut().zip(values).for_each(|(o, v)| *o = o.max(*v));
                }
            }
        });
        let channels = (images.patterns.len() * c) as f32;
        let status = (0..n)
            .into_par_iter()
            .map(|i| {
                if brightest[i] >= 1.0 {
                    PixelStatus::Saturated
                } else if contrast[i] < min_contrast || noise.is_underexposed(contrast[i], black[i], channels) {
                    PixelStatus::Underexposed
                } else {
                    PixelStatus::Valid
                }
            })
            .collect();
        Self {
            width: white.width,
            height: white.height,
            channels: c,
            planes,
            contrast,
            black,
            noise,
            status,
            has_black: images.black.is_some(),
        }
    }

    /// Returns the variance of normalized intensity `p` at a pixel.
    pub(crate) fn variance(&self, i: usize, p: f32) -> f32 {
        let c = self.contrast[i].max(1e-4);
        self.noise.normalized_variance(p.clamp(0.0, 1.0), c, self.black[i]) / self.channels as f32
    }

    /// Returns the mean over channels of an image's planes, for codes without color.
    pub(crate) fn gray(&self, image: usize, inverse: bool) -> std::borrow::Cow<'_, [f32]> {
        let mine: Vec<&[f32]> = self
            .planes
            .iter()
            .filter(|p| p.image == image)
            .map(|p| if inverse { &p.inverse[..] } else { &p.p[..] })
            .collect();
        match mine.as_slice() {
            [one] => std::borrow::Cow::Borrowed(one),
            some => {
                let n = some[0].len();
                let mean = |i: usize| some.iter().map(|p| p[i]).sum::<f32>() / some.len() as f32;
                (0..n).into_par_iter().map(mean).collect::<Vec<_>>().into()
            }
        }
    }
}
