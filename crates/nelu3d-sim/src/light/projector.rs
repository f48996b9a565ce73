//! A projector: pixels, a lens with a focus plane, an image plane like a camera's.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use nelu3d_scan::{Image, Projector};

use super::grid::PixelGrid;
use super::illumination::Illumination;
use super::sample::{LightSample, point_light_irradiance};
use crate::geometry::look_at;
use crate::spec::{BlackImage, PerColor, ProjectorSpec};

/// A projector and the images it shows, as light.
#[derive(Debug)]
pub(crate) struct ProjectorLight {
    spec: ProjectorSpec,
    projector: Projector,
    center: Point3<f64>,
    axis: Vector3<f64>,
    /// Tangents of the tilt of the plane of focus.
    focus_slope: [f64; 2],
    /// White, then all patterns.
    shown: PixelGrid,
    /// First channel in `shown` and number of channels of every pattern.
    channels: Vec<(usize, usize)>,
    /// Light of each channel (rows) in the camera's bands.
    primaries: [[f32; 3]; 3],
}

impl ProjectorLight {
    /// Returns a projector that shows `patterns` (codes in `[0, 1]`).
    pub(crate) fn new(spec: &ProjectorSpec, patterns: &[Image]) -> Self {
        let roll = UnitQuaternion::from_scaled_axis(Vector3::z() * spec.roll);
        let cam_from_proj = look_at(spec.position_mm, spec.target_mm) * roll;
        let optics = spec.optics().expect("checked with the spec");
        let projector = Projector { optics, proj_from_cam: cam_from_proj.inverse() };
        let white = Image { data: vec![1.0; spec.width * spec.height], ..Image::new(spec.width, spec.height, 1) };
        let mut images = vec![white];
        // Channels of different responses make a gray code a color.
        let colored = matches!(spec.gamma, PerColor::Each(_));
        images.extend(patterns.iter().map(|p| if colored { in_three_channels(p) } else { p.clone() }));
        // What it emits: from the code by its response, above its leak.
        let gamma = spec.gamma.rgb();
        for image in &mut images {
            for (i, v) in image.data.iter_mut().enumerate() {
                let light = f64::from(*v).powf(gamma[i % image.channels]);
                *v = (spec.black_leak + (1.0 - spec.black_leak) * light) as f32;
            }
        }
        let mut next = 1;
        let channels = images[1..].iter().map(|p| {
            next += p.channels;
            (next - p.channels, p.channels)
        });
        Self {
            center: Point3::from(spec.position_mm),
            axis: cam_from_proj * Vector3::z(),
            projector,
            focus_slope: spec.focus_tilt.map(f64::tan),
            channels: channels.collect(),
            shown: PixelGrid::new(&images, spec.fill_factor),
            primaries: spec.primaries.map(|row| row.map(|v| v as f32)),
            spec: spec.clone(),
        }
    }

    pub(super) fn move_by(&mut self, motion: &Isometry3<f64>) {
        self.center = motion * self.center;
        self.axis = motion * self.axis;
        self.projector.proj_from_cam *= motion.inverse();
    }

    /// Returns the projector as rigs describe it.
    pub(crate) fn projector(&self) -> &Projector {
        &self.projector
    }

    pub(super) fn sample(
        &self,
        p: &Point3<f64>,
        normal: &Vector3<f64>,
        is_visible: &dyn Fn(&Point3<f64>) -> bool,
    ) -> LightSample {
        let s = &self.spec;
        let strength = point_light_irradiance(p, normal, &self.center, &self.axis, s.reference_mm, s.vignetting);
        let local = self.projector.proj_from_cam * p;
        let Some(uv) = self.projector.optics.project(&local).filter(|_| strength > 0.0) else {
            return LightSample::default();
        };
        if !is_visible(&self.center) {
            return LightSample::default();
        }
        LightSample {
            strength: [strength; 2],
            uv,
            sigma: (s.sharp_sigma_px.powi(2) + self.defocus_px(&local).powi(2)).sqrt(),
        }
    }

    /// Returns the standard deviation of the blur away from the focus at a point of the projector's frame, px.
    ///
    /// Circle of confusion of a thin lens: its opening A, seen from the point through the plane of focus, has the
    /// diameter `A · |z − z_f| / z_f` at the point, and `A · f · |1/z_f − 1/z|` in pixels of the image plane. A uniform
    /// disc's standard deviation per axis is a quarter of its diameter. On a tilted plane `z = focus + x tan a_x + y
    /// tan a_y` the focus of the ray (x/z, y/z) is at `1/z_f = (1 − x/z tan a_x − y/z tan a_y) / focus`.
    fn defocus_px(&self, local: &Point3<f64>) -> f64 {
        let s = &self.spec;
        let [slope_x, slope_y] = self.focus_slope;
        let at_focus = (1.0 - (local.x * slope_x + local.y * slope_y) / local.z) / s.focus_mm;
        0.25 * s.aperture_mm * s.fx * (at_focus - 1.0 / local.z).abs()
    }

    pub(super) fn irradiance(
        &self,
        frames: &[Illumination],
        sample: &LightSample,
        scratch: &mut Vec<f32>,
        out: &mut [[f32; 3]],
    ) {
        let [strength, _] = sample.strength;
        if strength == 0.0 {
            out.fill([0.0; 3]);
            return;
        }
        scratch.resize(self.shown.channels(), 0.0);
        self.shown.at(sample.uv, sample.sigma, scratch);
        let black = if self.spec.black == BlackImage::Off { 0.0 } else { self.spec.black_leak as f32 };
        for (frame, rgb) in frames.iter().zip(out) {
            let emitted = match frame {
                Illumination::White => [scratch[0]; 3],
                Illumination::Black => [scratch[0] * black; 3],
                Illumination::Pattern(i) => match self.channels[*i] {
                    (at, 3) => [0, 1, 2].map(|c| scratch[at + c]),
                    (at, _) => [scratch[at]; 3],
                },
            };
            let p = &self.primaries;
            *rgb = [0, 1, 2].map(|band| strength * (0..3).map(|c| emitted[c] * p[c][band]).sum::<f32>());
        }
    }

    pub(super) fn in_image(&self, [u, v]: [f64; 2]) -> bool {
        let (w, h) = (self.spec.width as f64, self.spec.height as f64);
        u >= -0.5 && v >= -0.5 && u <= w - 0.5 && v <= h - 0.5
    }
}

/// Returns an image of red, green and blue: a gray one's channel thrice.
fn in_three_channels(image: &Image) -> Image {
    if image.channels == 3 {
        return image.clone();
    }
    Image { channels: 3, data: image.data.iter().flat_map(|v| [*v; 3]).collect(), ..image.clone() }
}
