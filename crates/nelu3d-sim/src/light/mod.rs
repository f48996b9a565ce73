//! Light sources: how much light of which color a point of a surface receives in which image.
//!
//! Every light promises: the places its light comes from (for shadows), what of a surface point matters to it (computed
//! once for all images of a shot), and from that the irradiance in every image. To add one, write its file, add it to
//! [`Light`] and to the spec.

mod blur;
mod film;
mod grid;
mod projector;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Projector;

use crate::spec::{BlackImage, LightSpec, Spec};
use blur::BlurStack;
pub(crate) use film::Film;
use grid::PixelGrid;
pub(crate) use projector::ProjectorLight;

/// What the light source shows in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Frame {
    /// The flash.
    White,
    /// What the spec says black is.
    Black,
    /// A pattern: its index among all images the light source can show.
    Pattern(usize),
}

/// A light source.
#[derive(Debug)]
pub(crate) enum Light {
    Projector(Box<ProjectorLight>),
    Film(Box<Film>),
}

/// What a light source needs to know about a surface point.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lit {
    /// Irradiance of white and of pattern light there, if nothing were in its way; 0 in shadow.
    strength: [f32; 2],
    /// Where on the light's image plane: px of a projector, mm of a film.
    uv: [f64; 2],
    /// Blur there, in the same unit: standard deviation.
    sigma: f64,
}

impl Light {
    /// The light of a checked spec. `patterns` are the images a projector shows (see [`Frame::Pattern`]), or the picture of
    /// a film that has one.
    pub(crate) fn new(spec: &Spec, patterns: &[nelu3d_scan::Image]) -> Self {
        match &spec.light {
            LightSpec::Projector(p) => Self::Projector(Box::new(ProjectorLight::new(p, patterns))),
            LightSpec::Film(f) => Self::Film(Box::new(Film::new(f, patterns.first()))),
        }
    }

    /// The calibrated projector, where it is one.
    pub(crate) fn projector(&self) -> Option<Projector> {
        match self {
            Self::Projector(p) => Some(p.projector().clone()),
            Self::Film(_) => None,
        }
    }

    /// What it needs to know about a surface point with unit normal `normal`. `sees` tells whether a place is in sight.
    pub(crate) fn lit(&self, p: &Point3<f64>, normal: &Vector3<f64>, sees: impl Fn(&Point3<f64>) -> bool) -> Lit {
        match self {
            Self::Projector(l) => l.lit(p, normal, sees),
            Self::Film(l) => l.lit(p, normal, sees),
        }
    }

    /// Irradiance in red, green and blue in every frame, without ambient light. 1: the flash of a lamp of strength 1, falling
    /// perpendicularly at the reference distance. `scratch` is memory to use again.
    pub(crate) fn irradiance(&self, frames: &[Frame], lit: &Lit, scratch: &mut Vec<f32>, out: &mut [[f32; 3]]) {
        assert_eq!(frames.len(), out.len(), "one irradiance per frame");
        match self {
            Self::Projector(l) => l.irradiance(frames, lit, scratch, out),
            Self::Film(l) => l.irradiance(frames, lit, out),
        }
    }

    /// Whether pattern light and white light reach the point, so that it can be reconstructed.
    pub(crate) fn reaches(&self, lit: &Lit) -> bool {
        let in_image = match self {
            Self::Projector(l) => l.in_image(lit.uv),
            Self::Film(l) => l.in_image(lit.uv),
        };
        in_image && lit.strength.iter().all(|s| *s > 0.0)
    }
}

/// Irradiance at a surface point from a small lamp at `from` with intensity cosⁿ about `axis`: inverse square law, the
/// surface's cosine, and the lamp's fall-off.
fn small_lamp(
    p: &Point3<f64>,
    normal: &Vector3<f64>,
    from: &Point3<f64>,
    axis: &Vector3<f64>,
    reference_mm: f64,
    vignetting: f64,
) -> f32 {
    let way = from - p;
    let distance = way.norm();
    let dir = way / distance;
    let (cosine, off_axis) = (normal.dot(&dir), -axis.dot(&dir));
    // NaN, for a point in the lamp itself, is no light either.
    if !(cosine > 0.0 && off_axis > 0.0) {
        return 0.0;
    }
    ((reference_mm / distance).powi(2) * cosine * off_axis.powf(vignetting)) as f32
}
