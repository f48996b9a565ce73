//! `nelu3d patterns`: the images a light source shows, made or judged.

mod score;

use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use nelu3d_scan::Image;
use nelu3d_scan::image::{write_png8, write_png16};
use nelu3d_scan::output::OutputDir;
use nelu3d_scan::pattern::{Axis, Pattern, PatternError, PatternImage, PatternImages, Ramp, Rgb, Sinusoid, Triangle};
use serde::Serialize;

use super::{Context, shown};
use crate::args::{Axes, Patterns, RgbParts, Sheet};

/// Says what is in a folder of patterns; proof that the folder may be replaced.
const ABOUT_FILE: &str = "patterns.json";

/// Runs the command.
pub(crate) fn run(args: Patterns, context: &Context) -> Result<ExitCode> {
    let (family, pattern, sheet) = match args {
        Patterns::Sinusoid { settings, sheet } => ("sinusoid", Pattern::Sinusoid(settings), sheet),
        Patterns::Triangle { settings, sheet } => ("triangle", Pattern::Triangle(settings), sheet),
        Patterns::Ramp { settings, sheet } => ("ramp", Pattern::Ramp(settings), sheet),
        Patterns::Random { settings, sheet } => ("random", Pattern::Random(settings), sheet),
        Patterns::Gray { settings, sheet } => ("gray", Pattern::Gray(settings), sheet),
        Patterns::Binary { settings, sheet } => ("binary", Pattern::Binary(settings), sheet),
        Patterns::Xor { settings, sheet } => ("xor", Pattern::Xor(settings), sheet),
        Patterns::Phase { settings, sheet } => ("phase", Pattern::Phase(settings), sheet),
        Patterns::Mps { settings, sheet } => ("mps", Pattern::Mps(settings), sheet),
        Patterns::Hilbert { settings, sheet } => ("hilbert", Pattern::Hilbert(settings), sheet),
        Patterns::Alacarte { settings, sheet } => ("alacarte", Pattern::Alacarte(settings), sheet),
        Patterns::Rgb { settings, sheet } => ("rgb", Pattern::Rgb(rgb(&settings)), sheet),
        Patterns::Film { settings, sheet } => ("film", Pattern::Film(settings), sheet),
        Patterns::Score(args) => return score::run(&args, context),
    };
    write(family, &pattern, &sheet, context)
}

fn rgb(parts: &RgbParts) -> Rgb {
    let red = Sinusoid { axis: Axis::X, period_px: parts.period, steps: 1 };
    let green = Triangle { axis: Axis::X, period_px: parts.triangle_period };
    let blue = parts.random;
    Rgb { parts: [Pattern::Sinusoid(red), Pattern::Triangle(green), Pattern::Random(blue)].map(Box::new) }
}

/// What was written.
#[derive(Debug, Serialize)]
struct About {
    /// Version of the program.
    nelu3d: &'static str,
    size: [usize; 2],
    bits: u8,
    gamma: f64,
    patterns: Vec<Pattern>,
    pattern_set: Set,
    white: &'static str,
    black: &'static str,
}

/// A pattern set as rig.toml lists it.
#[derive(Debug, Serialize)]
struct Set {
    name: &'static str,
    images: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    inverse: Vec<String>,
}

impl Set {
    /// Its entry in rig.toml.
    fn toml(&self) -> String {
        // The names are made of letters, digits, `_` and `.` only, so that they quote themselves.
        let mut text = format!("[[pattern_sets]]\nname = {:?}\nimages = {:?}\n", self.name, self.images);
        if !self.inverse.is_empty() {
            text += &format!("inverse = {:?}\n", self.inverse);
        }
        text
    }
}

fn write(family: &'static str, pattern: &Pattern, sheet: &Sheet, context: &Context) -> Result<ExitCode> {
    let axes: &[Axis] = match sheet.axis {
        Axes::X => &[Axis::X],
        Axes::Y => &[Axis::Y],
        Axes::Both => &[Axis::X, Axis::Y],
    };
    let [width, height] = sheet.size;
    // The lines below are made one pixel wide, so each side is tried here.
    let ramp = Pattern::Ramp(Ramp::default());
    if ramp.generate(width, 1).and(ramp.generate(height, 1)).is_err() {
        return Err(PatternError::Size { width, height }.into());
    }
    context.progress.stage("make patterns");
    let patterns =
        axes.iter().map(|&axis| pattern.along(axis).resolved(width, height)).collect::<Result<Vec<_>, _>>()?;
    // One line of each image is all there is to know: the whole of large sets would not fit into memory.
    let mut lines = PatternImages::default();
    for (pattern, axis) in patterns.iter().zip(axes) {
        let [w, h] = if *axis == Axis::X { [width, 1] } else { [1, height] };
        let mut more = pattern.generate(w, h)?;
        number_after(&lines.images, &mut more.images);
        number_after(&lines.inverse, &mut more.inverse);
        lines.images.extend(more.images);
        lines.inverse.extend(more.inverse);
    }

    let folder = OutputDir::create(&sheet.output, ABOUT_FILE)?;
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
    let about = About {
        nelu3d: env!("CARGO_PKG_VERSION"),
        size: sheet.size,
        bits: sheet.bits,
        gamma: sheet.gamma,
        patterns,
        pattern_set: Set { name: family, images: names(&lines.images), inverse: names(&lines.inverse) },
        white: "white.png",
        black: "black.png",
    };
    std::fs::write(folder.path().join(ABOUT_FILE), serde_json::to_vec_pretty(&about)?)?;
    context.stop_if_asked()?;
    folder.commit()?;

    let toml = about.pattern_set.toml();
    let mut json = serde_json::to_value(&about)?;
    json["output"] = serde_json::json!(sheet.output);
    json["toml"] = serde_json::json!(toml);
    context.answer(&json, || format!("# {n} images of {width} x {height} px in {}\n{toml}", shown(&sheet.output)))?;
    Ok(ExitCode::SUCCESS)
}

/// Where names of both would be equal, the numbers of `more` go on after those of `images`.
fn number_after(images: &[PatternImage], more: &mut [PatternImage]) {
    for p in more {
        let (stem, number) = p.name.rsplit_once('_').expect("named with a number");
        let taken = images.iter().filter(|i| i.name.rsplit_once('_').is_some_and(|n| n.0 == stem)).count();
        let number: usize = number.parse().expect("named with a number");
        p.name = format!("{stem}_{:02}", number + taken);
    }
}

/// Writes an image of one row, one column or one pixel, repeated to the sheet's size, as the codes that show it.
fn write_image(path: &Path, line: &Image, sheet: &Sheet) -> Result<()> {
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
