//! `nelu3d patterns score`: how well a folder of patterns tells its columns apart.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use nelu3d::result::picture::Picture;
use nelu3d_scan::Image;
use nelu3d_scan::image::read_any;
use nelu3d_scan::output::write_atomic;
use nelu3d_scan::pattern::{Axis, Codewords, Score, ScoreOptions, Stripes, confusion_matrix, score};
use serde::Serialize;

use crate::args::PatternScoreArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Maximum side of the picture, px.
const MAX_PICTURE_PX: usize = 1000;
/// Values that differ by less are equal: two codes of 8 bits.
const TOLERANCE: f32 = 2.5 / 255.0;

/// Score of the patterns that change along one axis.
#[derive(Debug, Serialize)]
struct AxisScore {
    axis: Axis,
    images: Vec<String>,
    #[serde(flatten)]
    score: Score,
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "nelu3d_scan::path_text::serialize_option")]
    picture: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &PatternScoreArgs, context: &CommandContext) -> Result<()> {
    context.progress.stage("read patterns");
    let read = read(&args.dir, context)?;
    let options = ScoreOptions {
        distances_px: args.beyond.clone(),
        sigma: args.noise,
        samples: args.samples as usize,
        seed: args.seed,
    };
    context.progress.stage("score");
    let codes: Vec<(Axis, Vec<String>, Codewords)> = [Axis::X, Axis::Y]
        .into_iter()
        .filter_map(|axis| {
            let of_axis = || read.lines.iter().filter(|l| l.axis == axis);
            let images: Vec<Image> = of_axis().map(|l| l.line.clone()).collect();
            let names = of_axis().map(|l| l.name.clone()).collect();
            (!images.is_empty()).then(|| (axis, names, Codewords::of_images(&images, axis)))
        })
        .collect();
    let several = codes.len() > 1;
    let mut scores = Vec::new();
    for (axis, images, words) in codes {
        let score = score(&words, &options);
        context.stop_if_asked()?;
        let picture = args.output.as_deref().map(|path| picture_path(path, axis, several));
        if let Some(path) = &picture {
            write_picture(path, &words)?;
        }
        scores.push(AxisScore { axis, images, score, picture });
    }
    let json = serde_json::json!({
        "patterns": shown(&args.dir),
        "size": read.size,
        "left_aside": read.skipped,
        "codes": scores,
    });
    context.answer(&json, || scores.iter().map(text).collect::<Vec<_>>().join("\n"))?;
    Ok(())
}

/// The patterns of a folder.
struct ReadPatterns {
    size: [usize; 2],
    lines: Vec<PatternLine>,
    /// Names of white, black, inverse and constant images.
    skipped: Vec<String>,
}

/// A pattern along its axis.
struct PatternLine {
    name: String,
    axis: Axis,
    /// One row or one column.
    line: Image,
}

/// Reads the patterns of a folder, which must all be of one size and change along one axis each.
fn read(dir: &Path, context: &CommandContext) -> Result<ReadPatterns> {
    let unreadable = || format!("{}: cannot be listed; name a folder of pattern images", shown(dir));
    let mut files = Vec::new();
    for entry in std::fs::read_dir(dir).with_context(unreadable)? {
        let path = entry.with_context(unreadable)?.path();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if ["png", "tif", "tiff", "exr"].contains(&extension.as_str()) && !path.is_dir() {
            files.push(path);
        }
    }
    files.sort();
    let mut skipped = Vec::new();
    let mut lines = Vec::new();
    let mut first: Option<(PathBuf, [usize; 2])> = None;
    for (i, path) in files.iter().enumerate() {
        context.progress.tick(i, files.len());
        context.stop_if_asked()?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if is_no_pattern(path) {
            skipped.push(name);
            continue;
        }
        let image = read_any(path)?;
        let size = [image.width, image.height];
        let (first_path, expected) = first.get_or_insert_with(|| (path.clone(), size));
        if size != *expected {
            bail!(
                "{}: is {}x{} pixels, but {} is {}x{}; put only the patterns of one light source into the folder",
                shown(path),
                size[0],
                size[1],
                shown(first_path),
                expected[0],
                expected[1]
            );
        }
        match Stripes::of(&image, TOLERANCE) {
            Stripes::Along(axis) => lines.push(PatternLine { name, axis, line: line(&image, axis) }),
            Stripes::Constant => skipped.push(name),
            Stripes::Both => bail!(
                "{}: changes along x and along y; only codes of stripes can be scored: take such images out of the folder",
                shown(path)
            ),
        }
    }
    match first {
        Some((_, size)) if !lines.is_empty() => Ok(ReadPatterns { size, lines, skipped }),
        _ => bail!(
            "{}: holds no pattern (of {} images: {}); name a folder of pattern images as `nelu3d patterns gray` writes it",
            shown(dir),
            files.len(),
            if skipped.is_empty() { "none".into() } else { skipped.join(", ") }
        ),
    }
}

/// Returns whether an image is white, black or inverse, by its name.
fn is_no_pattern(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    stem == "white" || stem == "black" || stem.split(['_', '-']).any(|part| part == "inv" || part == "inverse")
}

/// Returns the image's mean over the direction in which it does not change.
fn line(image: &Image, axis: Axis) -> Image {
    let words = Codewords::of_images(std::slice::from_ref(image), axis);
    let (width, height) = if axis == Axis::X { (image.width, 1) } else { (1, image.height) };
    Image { width, height, channels: image.channels, data: words.data }
}

/// Returns the file of the picture of an axis.
fn picture_path(path: &Path, axis: Axis, several: bool) -> PathBuf {
    if !several {
        return path.to_path_buf();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{}.png", axis.letter()))
}

/// Writes the picture of the distance in code space of every two columns: equal codes are dark.
fn write_picture(path: &Path, words: &Codewords) -> Result<()> {
    let (side, squared) = confusion_matrix(words, MAX_PICTURE_PX);
    let map: Vec<f32> = squared.iter().map(|d| d.sqrt()).collect();
    let max = map.iter().copied().fold(0.0, f32::max);
    let picture = Picture::of_map(&map, side, side, [0.0, f64::from(max)], colorous::MAGMA);
    write_atomic(path, |w: &mut dyn Write| w.write_all(&picture.png()))?;
    Ok(())
}

/// Returns a code's statistics for people.
fn text(code: &AxisScore) -> String {
    let s = &code.score;
    let (what, letter) = if code.axis == Axis::X { ("columns", 'x') } else { ("rows", 'y') };
    let mut text = format!("code         {} {what} along {letter}, {} values a pixel\n", s.columns, s.values);
    let slope = &s.sensitivity;
    text += &format!("sensitivity  {:.4} per px (median), {:.4} (minimum)\n", slope.median, slope.min);
    text += &format!("noise        {:.4}: {:.2} px at the median sensitivity\n", s.sigma, slope.sigma_px);
    for (name, errors) in [("nearest", Some(&s.nearest)), ("zncc", s.zncc.as_ref())] {
        if let Some(e) = errors {
            text += &format!(
                "{name:<12} error {:.3} px (mean), {:.1} (median), {:.3} (root mean square)\n",
                e.mean_px, e.median_px, e.rms_px
            );
        }
    }
    text += &format!(
        "\n{:>9}  {:>9}  {:<13}  {:>8}  {:>12}  {:>14}  {:>11}\n",
        "beyond px",
        "distance",
        format!("of {what}"),
        "1 − ZNCC",
        "within noise",
        "astray nearest",
        "astray zncc"
    );
    let percent = |v: f64| format!("{:.2} %", 100.0 * v);
    for (i, d) in s.separations.iter().enumerate() {
        let none = || "–".to_owned();
        let [a, b] = d.columns;
        let (distance, pair) = if d.euclidean.is_finite() {
            (format!("{:.4}", d.euclidean), format!("{a}, {b}"))
        } else {
            (none(), none())
        };
        text += &format!(
            "{:>9}  {distance:>9}  {pair:<13}  {:>8}  {:>12}  {:>14}  {:>11}\n",
            d.beyond_px,
            d.zncc.filter(|z| z.is_finite()).map_or_else(none, |z| format!("{z:.5}")),
            percent(d.within_noise),
            percent(s.nearest.beyond[i]),
            s.zncc.as_ref().map_or_else(none, |z| percent(z.beyond[i])),
        );
    }
    if let Some(path) = &code.picture {
        text += &format!("\npicture      {}\n", shown(path));
    }
    text
}
