//! The specs that come with the program. To add one, write its function in the file of its kind of scanner, and add it
//! to [`PRESETS`] and to [`Spec::preset`].

mod demo;
mod films;
mod parts;
mod projectors;

use crate::spec::Spec;

/// Names of the presets, and what each is.
pub const PRESETS: [(&str, &str); 7] = [
    ("demo", "a mono camera and a projector, three patterns, a board with markers, a vase"),
    ("shapes", "the scanner of `demo` with a plane, a ball, a step and a ball before a plane"),
    ("color", "a color camera and film: one color pattern and a flash, a charuco board, no black images of scenes"),
    (
        "dlp",
        "a machine-vision camera of 640 × 480 and a good DLP projector, three patterns, a sphere, a vase, two objects",
    ),
    ("lcd", "the same before a 50-dollar LCD projector: gaps, gamma, distortion, vignetting, no one plane of focus"),
    ("film-triton", "a LUCID Triton color camera and an RGB film projector, with a sequence of a flying ball"),
    (
        "film-chronos",
        "a Kron Chronos high-speed color camera, short of light, and the same film, with the same sequence",
    ),
];

impl Spec {
    /// Returns a spec that comes with the program by its name (see [`PRESETS`]), or `None` for an unknown name.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "demo" => Some(demo::demo()),
            "shapes" => Some(demo::shapes()),
            "color" => Some(demo::color()),
            "dlp" => Some(projectors::dlp()),
            "lcd" => Some(projectors::lcd()),
            "film-triton" => Some(films::triton()),
            "film-chronos" => Some(films::chronos()),
            _ => None,
        }
    }
}
