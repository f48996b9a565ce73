//! The page of a result: what was seen, what came out, how good it is, and how it came about.

mod captures;
mod curves;
mod maps;
mod tables;

use nelu3d::Surface;
use nelu3d::result::Summary;
use nelu3d::result::picture::Picture;
use nelu3d_evaluate::{GroundTruth, Metrics, TracePoint};
use nelu3d_scan::Image;
use nelu3d_scan::statistics::percentile;
use rayon::prelude::*;

pub use captures::Captures;
use captures::MAX_CAPTURE_WIDTH;

use super::html::{thumbnail, tiles};
use super::number::{grouped, percent, with_unit};
use super::page;
use super::viewer::{Coloring, viewer};

/// The page of a result.
pub struct ResultReport<'a> {
    /// The surface.
    pub surface: &'a Surface,
    /// Content of its `result.json`.
    pub summary: &'a Summary,
    /// Errors, when it was evaluated.
    pub metrics: Option<&'a Metrics>,
    /// Error over time, when it was traced.
    pub trace: Option<&'a [TracePoint]>,
    /// The captures that it was made from.
    pub captures: &'a Captures,
    /// The ground truth, when there is one.
    pub truth: Option<&'a GroundTruth>,
}

impl ResultReport<'_> {
    /// Returns the page.
    pub fn html(&self) -> String {
        let s = self.summary;
        let title = format!("{} · {}", s.scene, s.set);
        let subtitle = format!(
            "rig {} · {} × {} px · nelu3d {} · {} {}",
            s.rig_name, self.surface.width, self.surface.height, s.version, s.machine.os, s.machine.arch
        );
        let colorings = [Coloring::Clay, Coloring::Photo, Coloring::Depth, Coloring::Normals];
        let body = [
            self.tiles(),
            viewer(&self.surface.mesh, &colorings),
            self.metrics.map(tables::metrics_table).unwrap_or_default(),
            curves::section(&s.method, self.trace, self.surface, self.truth),
            page::section("Maps", &format!("<div class=grid>{}</div>", maps::maps(self.surface, self.truth))),
            format!(
                "<section class=columns><div><h2>Pixels</h2>{}</div><div><h2>Time</h2>{}</div></section>",
                tables::status_table(s),
                tables::stages_table(s)
            ),
            page::section("Captures", &format!("<div class='grid small'>{}</div>", self.captures())),
            self.normalized(),
            page::details("Settings and record of the method", true, &tables::value_table(&s.method)),
            page::details("Input files", false, &tables::inputs_table(s)),
        ];
        page::page(&title, &subtitle, &body.concat())
    }

    /// Shows the numbers one looks for first.
    fn tiles(&self) -> String {
        let s = self.summary;
        let mut numbers = vec![
            (grouped(s.pixels.valid), "points".to_owned()),
            (percent(s.pixels.valid as f64 / s.pixels.total as f64), "of all pixels".to_owned()),
            (with_unit(s.depth_mm.median_sigma, 2, "mm"), "median 1σ of depth".to_owned()),
        ];
        if let Some(m) = self.metrics {
            numbers.push((with_unit(m.body.depth_mm.median, 2, "mm"), "median error, body".to_owned()));
            numbers.push((with_unit(m.whole.depth_mm.mae, 2, "mm"), "mean error, whole".to_owned()));
        }
        numbers.push((with_unit(s.wall_secs, 1, "s"), format!("time ({:.1} CPU s)", s.cpu_secs)));
        if let Some(bytes) = s.peak_memory_bytes {
            numbers.push((format!("{:.0} MB", bytes as f64 / 1e6), "peak memory".to_owned()));
        }
        tiles(&numbers)
    }

    /// Shows the captures.
    fn captures(&self) -> String {
        let thumbnail =
            |(name, capture): &(String, Image)| thumbnail(&Picture::of_image(capture).at_most(MAX_CAPTURE_WIDTH), name);
        self.captures.images.par_iter().map(thumbnail).collect()
    }

    /// Shows the normalized images, (pattern − black) / (white − black), where white − black is bright enough.
    fn normalized(&self) -> String {
        let Captures { images, black } = self.captures;
        let Some(((_, white), patterns)) = images.split_first() else { return String::new() };
        let zero = |i: usize| black.as_ref().map_or(0.0, |b| b.data[i]);
        // Where white is darker, noise divided by next to nothing would be all there is to see.
        let spans: Vec<f64> = (0..white.data.len()).map(|i| f64::from(white.data[i] - zero(i))).collect();
        let min_span = 0.02 * percentile(&mut spans.clone(), 99.0).max(1e-6);
        let picture = |pattern: &Image| {
            let (channels, data) = (pattern.channels, &pattern.data);
            Picture::from_fn(pattern.width, pattern.height, |i| {
                let at = |c: usize| {
                    let j = channels * i + if channels == 3 { c } else { 0 };
                    (spans[j] > min_span).then(|| (f64::from(data[j] - zero(j)) / spans[j]).clamp(0.0, 1.0))
                };
                match [at(0), at(1), at(2)] {
                    [Some(r), Some(g), Some(b)] => [r, g, b].map(|v| (255.0 * v).round() as u8),
                    _ => [24, 26, 31],
                }
            })
        };
        let pictures: String =
            patterns.par_iter().map(|(name, p)| thumbnail(&picture(p).at_most(MAX_CAPTURE_WIDTH), name)).collect();
        let formula = if black.is_some() { "(pattern − black) / (white − black)" } else { "pattern / white" };
        let note =
            format!("<p class=note>{formula}, black = 0 and white = 1; dark where white (flash) is too dim.</p>");
        page::section("Normalized images", &format!("{note}<div class='grid small'>{pictures}</div>"))
    }
}

#[cfg(test)]
mod tests;
