//! A projector: pixels, a lens with a focus plane, an image plane like a camera's.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Image, Projector};

use super::{BlackImage, BlurStack, Frame, Lit, small_lamp};
use crate::scene::look_at;
use crate::spec::ProjectorSpec;

#[derive(Debug)]
pub(crate) struct ProjectorLight {
    spec: ProjectorSpec,
    projector: Projector,
    center: Point3<f64>,
    axis: Vector3<f64>,
    /// White, then all patterns.
    shown: BlurStack,
    /// First channel in `shown` and number of channels of every pattern.
    channels: Vec<(usize, usize)>,
}

impl ProjectorLight {
    /// A projector that shows `patterns` (codes in `[0, 1]`).
    pub(crate) fn new(spec: &ProjectorSpec, patterns: &[Image]) -> Self {
        let cam_from_proj = look_at(spec.position_mm, spec.target_mm);
        let optics = spec.optics().expect("checked with the spec");
        let projector = Projector { optics, proj_from_cam: cam_from_proj.inverse() };
        let white = Image { data: vec![1.0; spec.width * spec.height], ..Image::new(spec.width, spec.height, 1) };
        let mut images = vec![white];
        images.extend_from_slice(patterns);
        // What it emits: from the code by its response, above its leak.
        for v in images.iter_mut().flat_map(|i| &mut i.data) {
            let light = f64::from(*v).powf(spec.gamma);
            *v = (spec.black_leak + (1.0 - spec.black_leak) * light) as f32;
        }
        let mut next = 1;
        let channels = patterns.iter().map(|p| {
            next += p.channels;
            (next - p.channels, p.channels)
        });
        Self {
            center: Point3::from(spec.position_mm),
            axis: cam_from_proj * Vector3::z(),
            projector,
            channels: channels.collect(),
            shown: BlurStack::new(&images),
            spec: spec.clone(),
        }
    }

    pub(crate) fn projector(&self) -> &Projector {
        &self.projector
    }

    pub(super) fn lit(&self, p: &Point3<f64>, normal: &Vector3<f64>, sees: impl Fn(&Point3<f64>) -> bool) -> Lit {
        let s = &self.spec;
        let strength = small_lamp(p, normal, &self.center, &self.axis, s.reference_mm, s.vignetting);
        let local = self.projector.proj_from_cam * p;
        let Some(uv) = self.projector.optics.project(&local).filter(|_| strength > 0.0) else { return Lit::default() };
        if !sees(&self.center) {
            return Lit::default();
        }
        // Circle of confusion: the lens's opening seen through the focus plane, on the image plane in pixels. A uniform
        // disc's standard deviation per axis is a quarter of its diameter.
        let defocus = 0.25 * s.aperture_mm * s.fx * (1.0 / s.focus_mm - 1.0 / local.z).abs();
        Lit { strength: [strength; 2], uv, sigma: s.sharp_sigma_px.hypot(defocus) }
    }

    pub(super) fn irradiance(&self, frames: &[Frame], lit: &Lit, scratch: &mut Vec<f32>, out: &mut [[f32; 3]]) {
        let [strength, _] = lit.strength;
        if strength == 0.0 {
            out.fill([0.0; 3]);
            return;
        }
        scratch.resize(self.shown.channels(), 0.0);
        self.shown.at(lit.uv, lit.sigma, scratch);
        let black = if self.spec.black == BlackImage::Off { 0.0 } else { self.spec.black_leak as f32 };
        for (frame, rgb) in frames.iter().zip(out) {
            *rgb = match frame {
                Frame::White => [scratch[0] * strength; 3],
                Frame::Black => [scratch[0] * black * strength; 3],
                Frame::Pattern(i) => match self.channels[*i] {
                    (at, 3) => [0, 1, 2].map(|c| scratch[at + c] * strength),
                    (at, _) => [scratch[at] * strength; 3],
                },
            };
        }
    }

    pub(super) fn in_image(&self, [u, v]: [f64; 2]) -> bool {
        let (w, h) = (self.spec.width as f64, self.spec.height as f64);
        u >= -0.5 && v >= -0.5 && u <= w - 0.5 && v <= h - 0.5
    }
}
