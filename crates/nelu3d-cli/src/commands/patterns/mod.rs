//! `nelu3d patterns`: the images a light source shows, made or scored.

mod score;

use std::path::Path;

use anyhow::Result;
use nelu3d_scan::Image;
use nelu3d_scan::image::{write_png8, write_png16};
use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::pattern::{
    Axis, Pattern, PatternError, PatternImage, PatternImages, Ramp, Rgb, Sinusoid, Triangle, recommended_patterns,
};
use serde::Serialize;

use crate::args::{AxisChoice, PatternImageArgs, PatternsCommand, RgbArgs};
use crate::context::CommandContext;
use crate::paths::shown;

/// File that describes a folder of patterns, and marks it as one that may be replaced.
const METADATA_FILE: &str = "patterns.json";

/// Runs the command.
pub(crate) fn run(args: PatternsCommand, context: &CommandContext) -> Result<()> {
    let (family, pattern, sheet) = match args {
        PatternsCommand::Sinusoid { settings, sheet } => ("sinusoid", Pattern::Sinusoid(settings), sheet),
        PatternsCommand::Triangle { settings, sheet } => ("triangle", Pattern::Triangle(settings), sheet),
        PatternsCommand::Ramp { settings, sheet } => ("ramp", Pattern::Ramp(settings), sheet),
        PatternsCommand::Random { settings, sheet } => ("random", Pattern::Random(settings), sheet),
        PatternsCommand::Gray { settings, sheet } => ("gray", Pattern::Gray(settings), sheet),
        PatternsCommand::Binary { settings, sheet } => ("binary", Pattern::Binary(settings), sheet),
        PatternsCommand::Xor { settings, sheet } => ("xor", Pattern::Xor(settings), sheet),
        PatternsCommand::Phase { settings, sheet } => ("phase", Pattern::Phase(settings), sheet),
        PatternsCommand::Mps { settings, sheet } => ("mps", Pattern::Mps(settings), sheet),
        PatternsCommand::Hilbert { settings, sheet } => ("hilbert", Pattern::Hilbert(settings), sheet),
        PatternsCommand::Alacarte { settings, sheet } => ("alacarte", Pattern::Alacarte(settings), sheet),
        PatternsCommand::Superposition { settings, sheet } => {
            ("superposition", Pattern::Superposition(settings), sheet)
        }
        PatternsCommand::Rgb { settings, sheet } => ("rgb", Pattern::Rgb(rgb(&settings)), sheet),
        PatternsCommand::Film { settings, sheet } => ("film", Pattern::Film(settings), sheet),
        PatternsCommand::Score(args) => return score::run(&args, context),
        PatternsCommand::Recommended { settings, sheet } => {
            let name = format!("mixed{}", settings.images);
            let length = |axis: Axis| axis.length(sheet.size[0], sheet.size[1]);
            let set = |axis| recommended_patterns(length(axis), axis, settings.images);
            return write(&name, &set, &sheet, context);
        }
    };
    write(family, &|axis| Ok(vec![pattern.along(axis)]), &sheet, context)
}

/// Returns the patterns of family `rgb`.
fn rgb(parts: &RgbArgs) -> Rgb {
    let red = Sinusoid { axis: Axis::X, period_px: parts.period, steps: 1 };
    let green = Triangle { axis: Axis::X, period_px: parts.triangle_period };
    let blue = parts.random;
    Rgb { parts: [Pattern::Sinusoid(red), Pattern::Triangle(green), Pattern::Random(blue)].map(Box::new) }
}

/// Content of patterns.json.
#[derive(Debug, Serialize)]
struct PatternsMetadata {
    /// Version of the program.
    nelu3d: &'static str,
    size: [usize; 2],
    bits: u8,
    gamma: f64,
    patterns: Vec<Pattern>,
    pattern_set: PatternSetEntry,
    white: &'static str,
    black: &'static str,
}

/// A pattern set as rig.toml lists it.
#[derive(Debug, Serialize)]
struct PatternSetEntry {
    name: String,
    images: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    inverse: Vec<String>,
}

impl PatternSetEntry {
    /// Returns the entry of rig.toml.
    fn toml(&self) -> String {
        // The names are made of letters, digits, `_` and `.` only, so that they quote themselves.
        let mut text = format!("[[pattern_sets]]\nname = {:?}\nimages = {:?}\n", self.name, self.images);
        if !self.inverse.is_empty() {
            text += &format!("inverse = {:?}\n", self.inverse);
        }
        text
    }
}

/// The patterns of a set along an axis.
type SetAlong<'a> = dyn Fn(Axis) -> Result<Vec<Pattern>, PatternError> + 'a;

/// Makes the images, writes their folder and prints the entry of rig.toml.
fn write(name: &str, set: &SetAlong<'_>, sheet: &PatternImageArgs, context: &CommandContext) -> Result<()> {
    let (metadata, n) = make(name, set, sheet, context)?;
    let toml = metadata.pattern_set.toml();
    let [width, height] = sheet.size;
    let mut json = serde_json::to_value(&metadata)?;
    json["output"] = serde_json::json!(shown(&sheet.output));
    json["toml"] = serde_json::json!(toml);
    context.answer(&json, || format!("# {n} images of {width} x {height} px in {}\n{toml}", shown(&sheet.output)))?;
    Ok(())
}

/// Writes the folder of a recommended set along x.
#[cfg(feature = "capture")]
pub(crate) fn write_recommended(
    folder: &Path,
    size: [usize; 2],
    images: usize,
    context: &CommandContext,
) -> Result<()> {
    let sheet = PatternImageArgs { size, axis: AxisChoice::X, bits: 8, gamma: 1.0, output: folder.to_path_buf() };
    let set = |axis: Axis| recommended_patterns(axis.length(size[0], size[1]), axis, images);
    make(&format!("mixed{images}"), &set, &sheet, context).map(|_| ())
}

/// Writes the folder of the images whose light adds up.
#[cfg(feature = "capture")]
pub(crate) fn write_superposition(folder: &Path, size: [usize; 2], context: &CommandContext) -> Result<()> {
    let sheet = PatternImageArgs { size, axis: AxisChoice::X, bits: 8, gamma: 1.0, output: folder.to_path_buf() };
    let set = |_| Ok(vec![Pattern::Superposition(Default::default())]);
    make("superposition", &set, &sheet, context).map(|_| ())
}

/// Makes the images and writes their folder; returns what it says of itself, and the number of images.
fn make(
    name: &str,
    set: &SetAlong<'_>,
    sheet: &PatternImageArgs,
    context: &CommandContext,
) -> Result<(PatternsMetadata, usize)> {
    context.progress.stage("make patterns");
    let (patterns, lines) = generate(set, sheet)?;
    let folder = OutputDir::create(&sheet.output, METADATA_FILE)?;
    let all = lines.images.iter().chain(&lines.inverse);
    let n = lines.images.len() + lines.inverse.len() + 2;
    for (i, line) in all.enumerate() {
        context.progress.tick(i, n);
        context.stop_if_asked()?;
        write_image(&folder.path().join(format!("{}.png", line.name)), &line.image, sheet)?;
    }
    for (name, value) in [("white.png", 1.0), ("black.png", 0.0)] {
        write_image(&folder.path().join(name), &Image { width: 1, height: 1, channels: 1, data: vec![value] }, sheet)?;
    }
    let names = |images: &[PatternImage]| images.iter().map(|p| format!("{}.png", p.name)).collect();
    let metadata = PatternsMetadata {
        nelu3d: env!("CARGO_PKG_VERSION"),
        size: sheet.size,
        bits: sheet.bits,
        gamma: sheet.gamma,
        patterns,
        pattern_set: PatternSetEntry {
            name: name.into(),
            images: names(&lines.images),
            inverse: names(&lines.inverse),
        },
        white: "white.png",
        black: "black.png",
    };
    let text = serde_json::to_vec_pretty(&metadata)?;
    write_atomic(&folder.path().join(METADATA_FILE), |w| w.write_all(&text))?;
    context.stop_if_asked()?;
    folder.commit()?;
    Ok((metadata, n))
}

/// Makes the patterns along the axes that were asked for, with one line of each of their images: the whole of large
/// sets would not fit into memory.
fn generate(set: &SetAlong<'_>, sheet: &PatternImageArgs) -> Result<(Vec<Pattern>, PatternImages)> {
    let axes: &[Axis] = match sheet.axis {
        AxisChoice::X => &[Axis::X],
        AxisChoice::Y => &[Axis::Y],
        AxisChoice::Both => &[Axis::X, Axis::Y],
    };
    let [width, height] = sheet.size;
    // The lines below are made one pixel wide, so each side is tried here.
    let ramp = Pattern::Ramp(Ramp::default());
    if ramp.generate(width, 1).and(ramp.generate(height, 1)).is_err() {
        return Err(PatternError::Size { width, height }.into());
    }
    let mut patterns = Vec::new();
    let mut lines = PatternImages::default();
    for &axis in axes {
        let [w, h] = if axis == Axis::X { [width, 1] } else { [1, height] };
        let along = set(axis)?.iter().map(|p| p.resolved(width, height)).collect::<Result<Vec<_>, _>>()?;
        let mut more = nelu3d_scan::pattern::generate(&along, w, h)?;
        number_after(&lines.images, &mut more.images);
        number_after(&lines.inverse, &mut more.inverse);
        lines.images.extend(more.images);
        lines.inverse.extend(more.inverse);
        patterns.extend(along);
    }
    Ok((patterns, lines))
}

/// Numbers the images `more` after those of `images` that have the same name.
fn number_after(images: &[PatternImage], more: &mut [PatternImage]) {
    for p in more {
        let (stem, number) = p.name.rsplit_once('_').expect("named with a number");
        let taken = images.iter().filter(|i| i.name.rsplit_once('_').is_some_and(|n| n.0 == stem)).count();
        let number: usize = number.parse().expect("named with a number");
        p.name = format!("{stem}_{:02}", number + taken);
    }
}

/// Writes an image of one row, one column or one pixel, repeated to the sheet's size, as the codes that show it.
fn write_image(path: &Path, line: &Image, sheet: &PatternImageArgs) -> Result<()> {
    let [width, height] = sheet.size;
    let codes: Vec<f32> = line.data.iter().map(|&v| f64::from(v).powf(1.0 / sheet.gamma) as f32).collect();
    let channels = line.channels;
    let row: Vec<f32> = if line.width == width { codes.clone() } else { codes[..channels].repeat(width) };
    let data = if line.height == height && height > 1 {
        codes.chunks_exact(channels).flat_map(|pixel| pixel.repeat(width)).collect()
    } else {
        row.repeat(height)
    };
    let image = Image { width, height, channels, data };
    if sheet.bits == 8 {
        write_png8(path, &image, 0.0, 255.0)?
    } else {
        write_png16(path, &image, 0.0, 65535.0)?
    }
    Ok(())
}
