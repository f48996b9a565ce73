//! What the light source shows: every different image of the pattern sets once, or the film's picture.

use std::collections::HashMap;
use std::io;
use std::path::Path;

use nelu3d_scan::Image;
use nelu3d_scan::image::{RawData, decode, write_gray8, write_png8};
use nelu3d_scan::output::create_dir;
use nelu3d_scan::pattern::{self, PatternImage};
use nelu3d_scan::rig::PatternSet;

use crate::light::Frame;
use crate::spec::{FilmSpec, LightSpec, Spec, SpecError};

/// The images a light source shows, and the sets they belong to.
pub(crate) struct Shown {
    /// Every different image once, named as its file without extension; codes as the projector has them.
    pub(crate) images: Vec<PatternImage>,
    /// How many of `images`, from the first, are no inverses.
    n_patterns: usize,
    pub(crate) sets: Vec<PatternSet>,
}

impl Shown {
    /// What a checked spec's light source shows.
    pub(crate) fn new(spec: &Spec) -> Result<Self, SpecError> {
        let (width, height) = match &spec.light {
            LightSpec::Projector(p) => (p.width, p.height),
            LightSpec::Film(film) => {
                let image = PatternImage { name: "pattern".into(), image: picture(film)? };
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
        let mut images: Vec<PatternImage> = Vec::new();
        let mut taken: HashMap<String, usize> = HashMap::new();
        let mut place = |p: &PatternImage| {
            let image = eight_bits(&p.image);
            let (stem, number) = p.name.rsplit_once('_').expect("named with a number");
            let first: usize = number.parse().expect("named with a number");
            for number in first.. {
                let name = format!("{stem}_{number:02}");
                match taken.get(&name) {
                    // Sets that show the same image share it.
                    Some(&i) if images[i].image == image => return format!("{name}.png"),
                    Some(_) => {}
                    None => {
                        taken.insert(name.clone(), images.len());
                        let file = format!("{name}.png");
                        images.push(PatternImage { name, image });
                        return file;
                    }
                }
            }
            unreachable!("there are more numbers than images")
        };
        let patterns: Vec<Vec<String>> = made.iter().map(|m| m.images.iter().map(&mut place).collect()).collect();
        let inverses: Vec<Vec<String>> = made.iter().map(|m| m.inverse.iter().map(&mut place).collect()).collect();
        let n_patterns = patterns.iter().flatten().collect::<std::collections::HashSet<_>>().len();
        let sets = patterns
            .into_iter()
            .zip(inverses)
            .zip(&spec.pattern_sets)
            .map(|((images, inverse), set)| PatternSet { name: set.name.clone(), images, inverse })
            .collect();
        let known = |name: &&String| images.iter().any(|i| Some(i.name.as_str()) == name.strip_suffix(".png"));
        if let Some(name) = spec.camera.mono_images.iter().find(|name| !known(name)) {
            let names: Vec<&str> = images.iter().map(|i| i.name.as_str()).collect();
            let remedy = format!("give names of images that are shown: {}.png", names.join(".png, "));
            return Err(SpecError::Value { key: "camera.mono_images".into(), value: name.clone(), remedy });
        }
        Ok(Self { images, n_patterns, sets })
    }

    /// What to capture of a shot, with its file names.
    pub(crate) fn frames(&self, black: bool, inverses: bool) -> Vec<(Frame, String)> {
        let mut frames = vec![(Frame::White, "white.png".to_owned())];
        if black {
            frames.push((Frame::Black, "black.png".into()));
        }
        let n = if inverses { self.images.len() } else { self.n_patterns };
        frames.extend((0..n).map(|i| (Frame::Pattern(i), format!("{}.png", self.images[i].name))));
        frames
    }

    /// What to capture of a moving scene with a set (the first by default): its patterns, with their file names.
    pub(crate) fn frames_of_set(&self, name: Option<&str>) -> Vec<(Frame, String)> {
        let set = self.sets.iter().find(|s| name.is_none_or(|n| n == s.name)).expect("checked with the spec");
        let index = |file: &String| {
            self.images.iter().position(|i| file.strip_suffix(".png") == Some(&i.name)).expect("of its sets")
        };
        set.images.iter().map(|file| (Frame::Pattern(index(file)), file.clone())).collect()
    }
}

/// A film's picture: transmission in red, green and blue. Empty for a film of waves.
fn picture(film: &FilmSpec) -> Result<Image, SpecError> {
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

/// The codes an 8-bit projector has for an image.
fn eight_bits(image: &Image) -> Image {
    let data = image.data.iter().map(|v| (v * 255.0).round() / 255.0).collect();
    Image { data, ..image.clone() }
}

/// Writes the images a projector shows, and its white.
pub(crate) fn write_patterns(dir: &Path, images: &[PatternImage], [width, height]: [usize; 2]) -> io::Result<()> {
    create_dir(dir)?;
    for p in images {
        write_png8(&dir.join(format!("{}.png", p.name)), &p.image, 0.0, 255.0)?;
    }
    write_gray8(&dir.join("white.png"), width, height, &vec![255; width * height])
}
