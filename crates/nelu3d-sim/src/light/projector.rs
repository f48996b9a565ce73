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
    white: BlurStack,
    patterns: Vec<BlurStack>,
}

impl ProjectorLight {
    /// A projector that shows `patterns` (codes in `[0, 1]`).
    pub(crate) fn new(spec: &ProjectorSpec, patterns: Vec<Image>) -> Self {
        let cam_from_proj = look_at(spec.position_mm, spec.target_mm);
        let optics = spec.optics().expect("checked with the spec");
        let projector = Projector { optics, proj_from_cam: cam_from_proj.inverse() };
        let ones = Image { data: vec![1.0; spec.width * spec.height], ..Image::new(spec.width, spec.height, 1) };
        // What it emits: from the code by its response, above its leak.
        let emit = |mut image: Image| {
            for v in &mut image.data {
                let light = f64::from(*v).powf(spec.gamma);
                *v = (spec.black_leak + (1.0 - spec.black_leak) * light) as f32;
            }
            BlurStack::new(image)
        };
        Self {
            center: Point3::from(spec.position_mm),
            axis: cam_from_proj * Vector3::z(),
            projector,
            white: emit(ones),
            patterns: patterns.into_iter().map(emit).collect(),
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

    pub(super) fn irradiance(&self, frame: Frame, lit: &Lit) -> [f32; 3] {
        let [strength, _] = lit.strength;
        if strength == 0.0 {
            return [0.0; 3];
        }
        let (code, channels) = match frame {
            Frame::White => (self.white.at(lit.uv, lit.sigma), 1),
            Frame::Black if self.spec.black == BlackImage::Off => return [0.0; 3],
            Frame::Black => (self.white.at(lit.uv, lit.sigma).map(|v| v * self.spec.black_leak as f32), 1),
            Frame::Pattern(i) => (self.patterns[i].at(lit.uv, lit.sigma), self.patterns[i].channels()),
        };
        let rgb = if channels == 3 { code } else { [code[0]; 3] };
        rgb.map(|v| v * strength)
    }

    pub(super) fn in_image(&self, [u, v]: [f64; 2]) -> bool {
        let (w, h) = (self.spec.width as f64, self.spec.height as f64);
        u >= -0.5 && v >= -0.5 && u <= w - 0.5 && v <= h - 0.5
    }
}
