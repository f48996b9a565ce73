//! Light sources: how much light of which color a point of a surface receives in which image.
//!
//! Every light source promises `sample`, what of a surface point matters to it (computed once for all images of a shot,
//! with shadows), and `irradiance`, the light that arrives there in every image. To add one, write its file, add it to
//! `LightSource` and to the spec.

pub mod blur;
mod film;
pub mod grid;
mod illumination;
mod projector;
mod sample;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::Projector;

use crate::spec::{LightSpec, Spec};
use film::FilmLight;
pub(crate) use illumination::Illumination;
use projector::ProjectorLight;
pub(crate) use sample::LightSample;

/// A light source.
#[derive(Debug)]
pub(crate) enum LightSource {
    Projector(Box<ProjectorLight>),
    Film(Box<FilmLight>),
}

impl LightSource {
    /// Returns the light source of a checked spec. `patterns` are the images a projector shows (see
    /// [`Illumination::Pattern`]), or the picture of a film that has one.
    pub(crate) fn new(spec: &Spec, patterns: &[nelu3d_scan::Image]) -> Self {
        match &spec.light {
            LightSpec::Projector(p) => Self::Projector(Box::new(ProjectorLight::new(p, patterns))),
            LightSpec::Film(f) => Self::Film(Box::new(FilmLight::new(f, patterns.first()))),
        }
    }

    /// Moves the light source in the camera's frame.
    pub(crate) fn move_by(&mut self, motion: &Isometry3<f64>) {
        match self {
            Self::Projector(l) => l.move_by(motion),
            Self::Film(l) => l.move_by(motion),
        }
    }

    /// Returns the calibrated projector, or `None` for film.
    pub(crate) fn projector(&self) -> Option<Projector> {
        match self {
            Self::Projector(p) => Some(p.projector().clone()),
            Self::Film(_) => None,
        }
    }

    /// Returns what the light source needs to know about a surface point `p` with unit normal `normal`. `is_visible`
    /// tells whether nothing stands between the surface and a point that light comes from.
    pub(crate) fn sample(
        &self,
        p: &Point3<f64>,
        normal: &Vector3<f64>,
        is_visible: &dyn Fn(&Point3<f64>) -> bool,
    ) -> LightSample {
        match self {
            Self::Projector(l) => l.sample(p, normal, is_visible),
            Self::Film(l) => l.sample(p, normal, is_visible),
        }
    }

    /// Writes the irradiance in red, green and blue in every frame to `out`, without ambient light. 1: the flash of a
    /// lamp of strength 1, falling perpendicularly at the reference distance. `scratch` is memory to use again.
    pub(crate) fn irradiance(
        &self,
        frames: &[Illumination],
        sample: &LightSample,
        scratch: &mut Vec<f32>,
        out: &mut [[f32; 3]],
    ) {
        assert_eq!(frames.len(), out.len(), "one irradiance per frame");
        match self {
            Self::Projector(l) => l.irradiance(frames, sample, scratch, out),
            Self::Film(l) => l.irradiance(frames, sample, out),
        }
    }

    /// Whether pattern light and white light reach the point, so that it can be reconstructed.
    pub(crate) fn illuminates(&self, sample: &LightSample) -> bool {
        let in_image = match self {
            Self::Projector(l) => l.in_image(sample.uv),
            Self::Film(l) => l.in_image(sample.uv),
        };
        in_image && sample.strength.iter().all(|s| *s > 0.0)
    }
}
