//! The images that the light source shows: every different image of the pattern sets once, or the film's picture.

use std::collections::{HashMap, HashSet};
use std::io;
use std::path::Path;

use nelu3d_scan::Image;
use nelu3d_scan::image::{RawData, decode, write_gray8, write_png8};
use nelu3d_scan::output::create_dir;
use nelu3d_scan::pattern::{self, PatternImage};
use nelu3d_scan::rig::PatternSet;

use crate::light::Illumination;
use crate::spec::{FilmSpec, LightSpec, Spec, SpecError};

/// The images that a light source shows, and the pattern sets they belong to.
pub(crate) struct DisplayedImages {
    /// Every different image once, named as its file without extension; codes as the projector has them.
    pub(crate) images: Vec<PatternImage>,
    /// Number of `images`, from the first, that are no inverses.
    n_patterns: usize,
    /// The pattern sets, as the rig lists them.
    pub(crate) sets: Vec<PatternSet>,
}

impl DisplayedImages {
    /// Returns what a checked spec's light source shows.
    ///
    /// # Errors
    ///
    /// A pattern that cannot be made, a film's picture that cannot be read, or a name in `camera.mono_images` that no
    /// image has.
    pub(crate) fn new(spec: &Spec) -> Result<Self, SpecError> {
        let (width, height) = match &spec.light {
            LightSpec::Projector(p) => (p.width, p.height),
            LightSpec::Film(film) => {
                let image = PatternImage { name: "pattern".into(), image: read_film(film)? };
                let set = PatternSet { name: "film".into(), images: vec!["pattern.png".into()], inverse: Vec::new() };
                return Ok(Self { images: vec![image], n_patterns: 1, sets: vec![set] });
            }
        };
        let mut made = Vec::new();
        for set in &spec.pattern_sets {
            let images = pattern::generate(&set.patterns, width, height)
                .map_err(|source| SpecError::Pattern { set: set.name.clone(), source })?;
            made.push(images);
        }
        // All patterns come before all inverses.
        let mut distinct = DistinctImages::default();
        let patterns: Vec<Vec<String>> =
            made.iter().map(|m| m.images.iter().map(|p| distinct.insert(p)).collect()).collect();
        let inverses: Vec<Vec<String>> =
            made.iter().map(|m| m.inverse.iter().map(|p| distinct.insert(p)).collect()).collect();
        let images = distinct.images;
        let n_patterns = patterns.iter().flatten().collect::<HashSet<_>>().len();
        let sets = patterns
            .into_iter()
            .zip(inverses)
            .zip(&spec.pattern_sets)
            .map(|((images, inverse), set)| PatternSet { name: set.name.clone(), images, inverse })
            .collect();
        check_mono_images(&spec.camera.mono_images, &images)?;
        Ok(Self { images, n_patterns, sets })
    }

    /// Returns the images to capture of a shot, with their file names.
    pub(crate) fn shot_images(&self, black: bool, inverses: bool) -> Vec<(Illumination, String)> {
        let mut frames = vec![(Illumination::White, "white.png".to_owned())];
        if black {
            frames.push((Illumination::Black, "black.png".into()));
        }
        let n = if inverses { self.images.len() } else { self.n_patterns };
        frames.extend((0..n).map(|i| (Illumination::Pattern(i), format!("{}.png", self.images[i].name))));
        frames
    }

    /// Returns the patterns of a set (the first by default), with their file names.
    pub(crate) fn set_images(&self, name: Option<&str>) -> Vec<(Illumination, String)> {
        let set = self.sets.iter().find(|s| name.is_none_or(|n| n == s.name)).expect("checked with the spec");
        let index = |file: &String| {
            self.images.iter().position(|i| file.strip_suffix(".png") == Some(&i.name)).expect("of its sets")
        };
        set.images.iter().map(|file| (Illumination::Pattern(index(file)), file.clone())).collect()
    }
}

/// Different images by name.
#[derive(Default)]
struct DistinctImages {
    images: Vec<PatternImage>,
    /// Index in `images` by name.
    index: HashMap<String, usize>,
}

impl DistinctImages {
    /// Enters a pattern's image under the first free number from its own on and returns its file name. Sets that show
    /// the same image share it.
    fn insert(&mut self, pattern: &PatternImage) -> String {
        let image = to_eight_bits(&pattern.image);
        let (stem, number) = pattern.name.rsplit_once('_').expect("named with a number");
        let first: usize = number.parse().expect("named with a number");
        for number in first.. {
            let name = format!("{stem}_{number:02}");
            let file = format!("{name}.png");
            match self.index.get(&name) {
                Some(&i) if self.images[i].image == image => return file,
                Some(_) => {}
                None => {
                    self.index.insert(name.clone(), self.images.len());
                    self.images.push(PatternImage { name, image });
                    return file;
                }
            }
        }
        unreachable!("there are more numbers than images")
    }
}

/// Requires that all images that a camera takes in its mono mode are shown.
fn check_mono_images(mono_images: &[String], images: &[PatternImage]) -> Result<(), SpecError> {
    let known = |name: &&String| images.iter().any(|i| Some(i.name.as_str()) == name.strip_suffix(".png"));
    let Some(name) = mono_images.iter().find(|name| !known(name)) else { return Ok(()) };
    let names: Vec<&str> = images.iter().map(|i| i.name.as_str()).collect();
    let remedy = format!("give names of images that are shown: {}.png", names.join(".png, "));
    Err(SpecError::Value { key: "camera.mono_images".into(), value: name.clone(), remedy })
}

/// Reads a film's picture: transmission in red, green and blue. It is empty for a film of waves.
fn read_film(film: &FilmSpec) -> Result<Image, SpecError> {
    let Some(path) = &film.image else { return Ok(Image::new(0, 0, 3)) };
    let wrong =
        |remedy: String| SpecError::Value { key: "light.image".into(), value: path.display().to_string(), remedy };
    let raw = decode(path, None).map_err(|e| wrong(format!("a picture of the film must be there: {e}")))?;
    let data = match &raw.data {
        RawData::U8(v) => v.iter().map(|&v| f32::from(v) / 255.0).collect(),
        RawData::U16(v) => v.iter().map(|&v| f32::from(v) / 65535.0).collect(),
        RawData::Float(v) if v.iter().any(|v| !v.is_finite()) => return Err(wrong("give it finite values".into())),
        RawData::Float(v) => v.iter().map(|v| v.clamp(0.0, 1.0)).collect(),
    };
    let (width, height) = (raw.width, raw.height);
    let image = match raw.channels {
        3 => Image { width, height, channels: 3, data },
        _ => Image { width, height, channels: 3, data: data.iter().flat_map(|v| [*v; 3]).collect() },
    };
    let [x, y] = film.film_half_size_mm;
    let expected = width as f64 * y / x;
    if (expected - height as f64).abs() > 1.0 {
        let remedy = format!("its {width} × {height} px do not fill film_half_size_mm = [{x}, {y}] with square pixels");
        return Err(wrong(remedy));
    }
    Ok(image)
}

/// Returns an image in the codes that an 8-bit projector has for it.
fn to_eight_bits(image: &Image) -> Image {
    let data = image.data.iter().map(|v| (v * 255.0).round() / 255.0).collect();
    Image { data, ..image.clone() }
}

/// Writes the images that a projector shows, and its white.
pub(crate) fn write_patterns(dir: &Path, images: &[PatternImage], [width, height]: [usize; 2]) -> io::Result<()> {
    create_dir(dir)?;
    for p in images {
        write_png8(&dir.join(format!("{}.png", p.name)), &p.image, 0.0, 255.0)?;
    }
    write_gray8(&dir.join("white.png"), width, height, &vec![255; width * height])
}
