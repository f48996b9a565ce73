//! A scene's captures as decoders want them: normalized by white and black, one plane per image and channel.

use nelu3d_scan::rig::{Need, PatternSet, RigError, Shot};
use nelu3d_scan::{Image, Rig};
use rayon::prelude::*;

use crate::calibrate::noise::{NoiseEstimator, NoiseModel};
use crate::result::Left;

/// The images of a scene, linear.
pub(super) struct Images {
    pub(super) white: Image,
    pub(super) black: Option<Image>,
    pub(super) patterns: Vec<Image>,
    pub(super) inverse: Vec<Image>,
}

impl Images {
    /// Reads a scene, with the inverse images of the set.
    pub(super) fn read(rig: &Rig, shot: &Shot, set: &PatternSet) -> Result<Self, RigError> {
        let (capture, inverse) = rayon::join(|| rig.read_shot(shot, set, Need::Scene), || rig.read_inverse(shot, set));
        let capture = capture?;
        Ok(Self { white: capture.white, black: capture.black, patterns: capture.patterns, inverse: inverse? })
    }

    /// Reads a board position: it must have a black image.
    pub(super) fn read_position(rig: &Rig, shot: &Shot, set: &PatternSet) -> Result<Self, RigError> {
        let capture = rig.read_shot(shot, set, Need::Calibration)?;
        let inverse = rig.read_inverse(shot, set)?;
        Ok(Self { white: capture.white, black: capture.black, patterns: capture.patterns, inverse })
    }
}

/// One image, or one channel of one.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    /// Place in the pattern set.
    pub(super) image: usize,
    /// Camera channel.
    pub(super) channel: usize,
    /// (pattern − black) / (white − black), one a pixel; meaningless where a pixel is left out.
    pub(super) p: Vec<f32>,
    /// The same of the inverse image; empty when there is none.
    pub(super) inverse: Vec<f32>,
}

/// Normalized captures.
pub(super) struct Captured {
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
    /// Dark and clipped pixels.
    pub(super) left: Vec<Left>,
    pub(super) has_black: bool,
}

/// The largest standard deviation of the normalized intensity with which an image still tells something.
const MAX_SIGMA: f32 = 0.12;

impl Captured {
    /// Normalizes. Without a black image, there is taken to be no ambient light.
    pub(super) fn new(images: &Images, rig: &Rig, min_contrast: f32) -> Self {
        let white = &images.white;
        let (n, c) = (white.width * white.height, white.channels);
        let mut estimator = NoiseEstimator::default();
        [white].into_iter().chain(images.patterns.iter().take(3)).for_each(|image| estimator.add(image));
        let noise = estimator.finish((1.0 / (rig.saturation - rig.black_level).max(1e-9)) as f32);
        let black_at = |j: usize| images.black.as_ref().map_or(0.0, |b| b.data[j]);
        let mean = |f: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
            (0..n).into_par_iter().map(|i| (i * c..(i + 1) * c).map(f).sum::<f32>() / c as f32).collect()
        };
        let black = mean(&black_at);
        let contrast = mean(&|j| white.data[j] - black_at(j));
        let plane = |image: &Image, ch: usize| -> Vec<f32> {
            let one = |i: usize| {
                let j = i * c + ch;
                (image.data[j] - black_at(j)) / (white.data[j] - black_at(j)).max(1e-4)
            };
            (0..n).into_par_iter().map(one).collect()
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
        let clipped = |i: usize| {
            [white]
                .into_iter()
                .chain(&images.patterns)
                .chain(&images.inverse)
                .any(|image| image.data[i * c..(i + 1) * c].iter().any(|v| *v >= 1.0))
        };
        let left = (0..n)
            .into_par_iter()
            .map(|i| {
                if clipped(i) {
                    Left::Clipped
                } else if contrast[i] < min_contrast
                    || noise.normalized_variance(0.5, contrast[i], black[i]) > MAX_SIGMA * MAX_SIGMA
                {
                    Left::Dark
                } else {
                    Left::Kept
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
            left,
            has_black: images.black.is_some(),
        }
    }

    /// Variance of normalized intensity `p` at a pixel.
    pub(super) fn variance(&self, i: usize, p: f32) -> f32 {
        let c = self.contrast[i].max(1e-4);
        self.noise.normalized_variance(p.clamp(0.0, 1.0), c, self.black[i]) / self.channels as f32
    }

    /// The mean over channels of an image's plane, for codes without color.
    pub(super) fn gray(&self, image: usize, inverse: bool) -> std::borrow::Cow<'_, [f32]> {
        let of = |p: &'_ Plane| -> usize { p.image };
        let mine: Vec<&[f32]> = self
            .planes
            .iter()
            .filter(|p| of(p) == image)
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
