//! The page of a result: what was seen, what came out, how good it is, and how it came about.

use std::fmt::Write;

use nelu3d::result::Summary;
use nelu3d::result::picture::{DEPTH_COLORS, Picture, limits, status_color};
use nelu3d::surface::{PixelStatus, Surface};
use nelu3d_evaluate::{GroundTruth, Metrics, TracePoint};
use nelu3d_scan::Image;
use nelu3d_scan::statistics::percentile;
use serde_json::Value;

use super::chart::{Axis, Chart, Mark, Series, curve};
use super::html::{color_bar, escape, figure, img, legend, table, thumbnail, tiles};
use super::number::{grouped, percent, with_unit};
use super::{MAP_WIDTH, page, viewer};

/// Pictures of captures are at most this wide.
const CAPTURE_WIDTH: usize = 320;

/// What a page shows.
pub(crate) struct Page<'a> {
    /// The surface.
    pub surface: &'a Surface,
    /// What its `result.json` says.
    pub summary: &'a Summary,
    /// Its errors, when there is a ground truth.
    pub metrics: Option<&'a Metrics>,
    /// Its error over time, when it was traced.
    pub trace: Option<&'a [TracePoint]>,
    /// The captures it was made from, with their names; white first.
    pub captures: &'a [(String, Image)],
    /// The scene without the pattern light, when there is such an image.
    pub black: Option<&'a Image>,
    /// The truth, when there is one.
    pub truth: Option<&'a GroundTruth>,
}

impl Page<'_> {
    /// The page.
    pub(crate) fn html(&self) -> String {
        let s = self.summary;
        let title = format!("{} · {}", s.scene, s.set);
        let subtitle = format!(
            "rig {} · {} × {} px · nelu3d {} · {} {}",
            s.rig_name, self.surface.width, self.surface.height, s.version, s.machine.os, s.machine.arch
        );
        let colorings =
            [viewer::Coloring::Clay, viewer::Coloring::Photo, viewer::Coloring::Depth, viewer::Coloring::Normals];
        let body = [
            self.tiles(),
            viewer::viewer(&self.surface.mesh, &colorings),
            self.metrics.map(metrics_table).unwrap_or_default(),
            self.curves(),
            page::section("Maps", &format!("<div class=grid>{}</div>", self.maps())),
            format!(
                "<section class=columns><div><h2>Pixels</h2>{}</div><div><h2>Time</h2>{}</div></section>",
                status_table(s),
                stages_table(s)
            ),
            page::section("Captures", &format!("<div class='grid small'>{}</div>", self.captures())),
            self.normalized(),
            page::details("Settings and record of the method", true, &value_table(&s.method)),
            page::details("Input files", false, &inputs_table(s)),
        ];
        page::page(&title, &subtitle, &body.concat())
    }

    /// The numbers one looks for first.
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

    fn maps(&self) -> String {
        let r = self.surface;
        let (w, h) = (r.width, r.height);
        let mut html = String::new();
        let mut add = |name: &str, note: &str, picture: Picture, legend: String| {
            html += &figure(name, note, &(img(&picture.at_most(MAP_WIDTH), name) + &legend));
        };

        // Near is bright, as in the preview.
        let [near, far] = limits(&r.depth, 1.0, 99.0);
        let nearness: Vec<f32> = r.depth.iter().map(|&z| (near + far) as f32 - z).collect();
        let picture = Picture::of_map(&nearness, w, h, [near, far], DEPTH_COLORS);
        add("Depth", "camera z", picture, color_bar(DEPTH_COLORS, [far, near], "mm"));

        if let Some(truth) = self.truth {
            let error: Vec<f32> =
                (0..w * h).map(|i| if truth.mask[i] { r.depth[i] - truth.depth[i] } else { f32::NAN }).collect();
            let mut magnitudes: Vec<f64> =
                error.iter().filter(|e| e.is_finite()).map(|&e| f64::from(e).abs()).collect();
            let p95 = percentile(&mut magnitudes, 95.0);
            let range = if p95 > 0.0 { [-p95, p95] } else { [-1.0, 1.0] };
            let picture = Picture::of_map(&error, w, h, range, colorous::RED_BLUE);
            add("Error", "depth − truth", picture, color_bar(colorous::RED_BLUE, range, "mm"));
        }

        let normals = Picture::from_fn(w, h, |i| {
            let [x, y, z] = r.normals[i];
            if x.is_finite() { [x, -y, -z].map(|c| ((c + 1.0) * 127.5) as u8) } else { [24, 26, 31] }
        });
        add("Normals", "red right, green up, blue towards the camera", normals, String::new());

        let scalar = [
            ("1σ of depth", "how far to trust it", &r.sigma, colorous::INFERNO, "mm"),
            (
                "Residual",
                "what the surface leaves unexplained, RMS of normalized intensity",
                &r.residual,
                colorous::INFERNO,
                "",
            ),
            ("Ambient", "learned share of light that is not direct", &r.ambient, colorous::CIVIDIS, ""),
        ];
        for (name, note, map, colors, unit) in scalar {
            let range = [0.0, limits(map, 1.0, 98.0)[1].max(1e-6)];
            add(name, note, Picture::of_map(map, w, h, range, colors), color_bar(colors, range, unit));
        }
        add("Left out", "why pixels have no depth", Picture::of_status(&r.status, w, h), status_legend());
        html
    }

    fn captures(&self) -> String {
        let thumbnail =
            |(name, capture): &(String, Image)| thumbnail(&Picture::of_image(capture).at_most(CAPTURE_WIDTH), name);
        self.captures.iter().map(thumbnail).collect()
    }
}

impl Page<'_> {
    /// What the method looks at: (pattern − black) / (white − black), from 0 to 1, where the flash is bright enough.
    fn normalized(&self) -> String {
        let Some(((_, white), patterns)) = self.captures.split_first() else { return String::new() };
        let zero = |i: usize| self.black.map_or(0.0, |b| b.data[i]);
        // Where the flash is darker, noise divided by next to nothing would be all there is to see.
        let spans: Vec<f64> = (0..white.data.len()).map(|i| f64::from(white.data[i] - zero(i))).collect();
        let least = 0.02 * percentile(&mut spans.clone(), 99.0).max(1e-6);
        let picture = |pattern: &Image| {
            let (channels, data) = (pattern.channels, &pattern.data);
            Picture::from_fn(pattern.width, pattern.height, |i| {
                let at = |c: usize| {
                    let j = channels * i + if channels == 3 { c } else { 0 };
                    (spans[j] > least).then(|| (f64::from(data[j] - zero(j)) / spans[j]).clamp(0.0, 1.0))
                };
                match [at(0), at(1), at(2)] {
                    [Some(r), Some(g), Some(b)] => [r, g, b].map(|v| (255.0 * v).round() as u8),
                    _ => [24, 26, 31],
                }
            })
        };
        let pictures: String =
            patterns.iter().map(|(name, p)| thumbnail(&picture(p).at_most(CAPTURE_WIDTH), name)).collect();
        let formula = if self.black.is_some() { "(pattern − black) / (white − black)" } else { "pattern / white" };
        let note = format!("<p class=note>{formula}, black = 0 and white = 1; dark where the flash is too dim.</p>");
        page::section("Normalized images", &format!("{note}<div class='grid small'>{pictures}</div>"))
    }

    /// Loss and error by iteration and time, and whether 1σ is calibrated: what of it there is.
    fn curves(&self) -> String {
        let mut html = String::new();
        let mut add = |name: &str, note: &str, chart: Chart| {
            html += &figure(name, note, &(chart.svg() + &chart.legend()));
        };
        let losses = losses(&self.summary.method);
        if !losses.is_empty() {
            let values = || losses.iter().flat_map(|s| s.points.iter().map(|p| p[1]));
            let y = Axis::log_if_wide("loss", values(), 20.0);
            add("Loss", "by iteration", Chart { x: Axis::linear("iteration"), y, series: losses.clone() });
        }
        if let Some(trace) = self.trace.filter(|t| t.len() > 1) {
            let series = |label: &str, value: &dyn Fn(&TracePoint) -> f64| Series {
                label: label.to_owned(),
                points: trace.iter().map(|p| [p.wall_secs, value(p)]).collect(),
                spread: Vec::new(),
                mark: Mark::Line,
            };
            let series = vec![
                series("mean, whole", &|p| p.mae),
                series("RMS, whole", &|p| p.rmse),
                series("median, body", &|p| p.body_median),
            ];
            let values = || series.iter().flat_map(|s| s.points.iter().map(|p| p[1]));
            let y = Axis::log_if_wide("error, mm", values(), 10.0);
            add("Error", "by time since the start", Chart { x: Axis::linear("s"), y, series: series.clone() });
        }
        if let Some(chart) = self.truth.and_then(|truth| calibration(self.surface, truth)) {
            add("Is 1σ calibrated?", "share of errors within so many σ", chart);
        }
        if html.is_empty() { html } else { page::section("Curves", &format!("<div class=grid>{html}</div>")) }
    }
}

/// The losses on record: a list of numbers, one an iteration, or of records that have an `iteration` and several losses.
fn losses(method: &Value) -> Vec<Series> {
    let line = |label: &str, points: Vec<[f64; 2]>| Series {
        label: label.to_owned(),
        points,
        spread: Vec::new(),
        mark: Mark::Line,
    };
    let numbers = |label: &str, list: &[Value]| {
        let point = |(i, v): (usize, &Value)| Some([i as f64 + 1.0, v.as_f64()?]);
        line(label, list.iter().enumerate().filter_map(point).collect())
    };
    let series = match method.get("losses") {
        Some(Value::Array(list)) if list.iter().all(Value::is_number) => vec![numbers("total", list)],
        Some(Value::Array(records)) => ["image", "mask", "eikonal", "sparsity"]
            .iter()
            .map(|&key| {
                let point = |r: &Value| Some([r.get("iteration")?.as_f64()?, r.get(key)?.as_f64()?]);
                line(key, records.iter().filter_map(point).collect())
            })
            .collect(),
        Some(Value::Object(map)) => map.iter().filter_map(|(k, v)| Some(numbers(k, v.as_array()?))).collect::<Vec<_>>(),
        _ => Vec::new(),
    };
    series.into_iter().filter(|s| s.points.len() > 1 && s.points.iter().any(|p| p[1] != 0.0)).collect()
}

/// The share of errors within n σ against n, with what Gaussian errors would give; `None` without errors.
fn calibration(result: &Surface, truth: &GroundTruth) -> Option<Chart> {
    let ratio = |i: usize| f64::from((result.depth[i] - truth.depth[i]).abs() / result.sigma[i]);
    let mut ratios: Vec<f64> =
        (0..result.depth.len()).filter(|&i| truth.mask[i]).map(ratio).filter(|r| r.is_finite()).collect();
    if ratios.is_empty() {
        return None;
    }
    ratios.sort_by(f64::total_cmp);
    let within = |n: f64| ratios.partition_point(|&r| r <= n) as f64 / ratios.len() as f64;
    let steps = || (0..=40).map(|i| 0.1 * f64::from(i));
    let line =
        |label: &str, points: Vec<[f64; 2]>, mark| Series { label: label.to_owned(), points, spread: Vec::new(), mark };
    Some(Chart {
        x: Axis::linear("σ"),
        y: Axis::linear("share of pixels"),
        series: vec![
            line("measured", steps().map(|n| [n, within(n)]).collect(), Mark::Line),
            line("Gaussian", steps().map(|n| [n, within_sigmas(n)]).collect(), Mark::Ideal),
        ],
    })
}

/// Share of Gaussian errors within n σ: erf(n/√2), by Abramowitz and Stegun 7.1.26 (to 1.5e-7).
fn within_sigmas(n: f64) -> f64 {
    let x = n / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let poly =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    1.0 - poly * (-x * x).exp()
}

fn metrics_table(metrics: &Metrics) -> String {
    let legend = "<p class=note>whole: everything the light source and the camera both see. body: without 3 px next to \
                  silhouettes, shadow borders and depth jumps. grazing: seen at more than 70°. Errors are over the \
                  pixels that have a depth; bias is ours − truth.</p>";
    page::section("Error against the truth", &(table(&metrics.headings(), &metrics.rows()) + legend))
}

fn status_table(s: &Summary) -> String {
    let count = |l: PixelStatus| match l {
        PixelStatus::Valid => s.pixels.valid as u64,
        _ => s.pixels.rejected[l.key()].as_u64().unwrap_or(0),
    };
    let rows: Vec<Vec<String>> = PixelStatus::ALL
        .iter()
        .map(|&l| {
            let n = count(l);
            vec![l.label().to_owned(), grouped(n as usize), percent(n as f64 / s.pixels.total as f64)]
        })
        .collect();
    table(&["pixels", "number", "share"], &rows)
}

fn stages_table(s: &Summary) -> String {
    let row = |name: &str, wall: f64, cpu: f64| vec![name.to_owned(), format!("{wall:.2}"), format!("{cpu:.2}")];
    let mut rows: Vec<Vec<String>> = s.stages.iter().map(|t| row(&t.name, t.wall_secs, t.cpu_secs)).collect();
    rows.push(row("total", s.wall_secs, s.cpu_secs));
    table(&["stage", "s", "CPU s"], &rows)
}

fn inputs_table(s: &Summary) -> String {
    let row =
        |i: &nelu3d::result::Input| vec![i.path.display().to_string(), grouped(i.bytes as usize), i.sha256.clone()];
    table(&["file", "bytes", "SHA-256"], &s.inputs.iter().map(row).collect::<Vec<_>>())
}

fn status_legend() -> String {
    legend(&PixelStatus::ALL.map(|l| (status_color(l), l.label())))
}

/// Whatever the method put on record, one line a value; long lists of numbers as curves.
fn value_table(values: &Value) -> String {
    fn lines(path: &str, value: &Value, out: &mut String) {
        let mut line = |cell: &str| {
            let _ = write!(out, "<tr><td>{}</td><td>{cell}</td></tr>", escape(path));
        };
        match value {
            Value::Object(map) => {
                for (key, v) in map {
                    let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                    lines(&path, v, out);
                }
            }
            Value::Array(list) if list.len() > 8 && list.iter().all(Value::is_number) => {
                line(&curve(&list.iter().filter_map(Value::as_f64).collect::<Vec<_>>()));
            }
            Value::String(s) => line(&escape(s)),
            other => line(&escape(&other.to_string())),
        }
    }
    let mut out = String::new();
    lines("", values, &mut out);
    format!("<div class=scroll><table class=values>{out}</table></div>")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nelu3d::progress::StageTime;
    use nelu3d::result::ResultMetadata;
    use nelu3d_evaluate::{EvaluatedMaps, evaluate};
    use nelu3d_scan::{Camera, Mesh};

    /// A ball of 100 mm before a wall, seen by a small camera, as its own truth plus a ripple of 0.2 mm.
    fn ball() -> (Surface, Camera, GroundTruth) {
        let (width, height) = (320, 240);
        let camera = Camera::pinhole(width, height, 400.0, 400.0, 159.5, 119.5);
        let n = width * height;
        let (mut depth, mut normals) = (vec![700.0; n], vec![[0.0, 0.0, -1.0]; n]);
        for i in 0..n {
            let dir = camera.ray([(i % width) as f64, (i / width) as f64]).dir;
            let center = nalgebra::Vector3::new(0.0, 0.0, 600.0);
            let (b, c) = (dir.dot(&center), center.norm_squared() - 100.0 * 100.0);
            if b * b > c {
                let p = dir * (b - (b * b - c).sqrt());
                let normal = (p - center) / 100.0;
                depth[i] = p.z as f32;
                normals[i] = [normal.x as f32, normal.y as f32, normal.z as f32];
            }
        }
        let truth = GroundTruth { width, height, depth: depth.clone(), mask: vec![true; n] };
        let mut status = vec![PixelStatus::Valid; n];
        for i in 0..n {
            depth[i] += 0.2 * ((i % width) as f32 * 0.2).sin();
            if i % width < 20 {
                status[i] = if i / width < 120 { PixelStatus::Underexposed } else { PixelStatus::DepthDiscontinuity };
                depth[i] = f32::NAN;
                normals[i] = [f32::NAN; 3];
            }
        }
        let vertices: Vec<[f32; 3]> = (0..n)
            .map(|i| {
                let ray = camera.ray([(i % width) as f64, (i / width) as f64]);
                let p = ray.at(f64::from(truth.depth[i]) / ray.dir.z);
                [p.x as f32, p.y as f32, p.z as f32]
            })
            .collect();
        let quads = (0..height - 1).flat_map(|y| (0..width - 1).map(move |x| (y * width + x) as u32));
        let w = width as u32;
        let faces = quads.flat_map(|i| [[i, i + w, i + 1], [i + 1, i + w, i + w + 1]]).collect();
        let white = Image {
            width,
            height,
            channels: 1,
            data: normals.iter().map(|n| if n[2].is_finite() { -0.8 * n[2] } else { 0.02 }).collect(),
        };
        let colors = (0..n as u32)
            .map(|i| if (i / 16 + i / w / 16).is_multiple_of(2) { [230, 120, 60] } else { [70; 3] })
            .collect();
        let result = Surface {
            width,
            height,
            sigma: depth.iter().map(|z| 0.0002 * z).collect(),
            residual: depth.iter().map(|z| 0.01 + 0.0 * z).collect(),
            ambient: depth.iter().map(|z| 0.1 + 0.0 * z).collect(),
            depth,
            normals,
            status,
            white,
            mesh: Mesh { vertices, normals: Vec::new(), colors, faces },
        };
        (result, camera, truth)
    }

    #[test]
    fn a_page_needs_nothing_else_and_is_small() {
        let (result, camera, truth) = ball();
        let maps = EvaluatedMaps { depth: &result.depth, normals: Some(&result.normals), sigma: Some(&result.sigma) };
        let metrics = evaluate(&maps, &truth, &truth.regions(&camera), &camera, None);
        let about = ResultMetadata { scene: "<ball>".to_owned(), ..ResultMetadata::default() };
        let losses: Vec<f64> = (0..200).map(|i| (-0.02 * f64::from(i)).exp()).collect();
        let method = serde_json::json!({ "seed": 7, "losses": { "image": losses } });
        let stages = [StageTime { name: "guess & <check>".to_owned(), wall_secs: 1.5, cpu_secs: 2.5 }];
        let summary = Summary::new(&result, &method, &stages, &camera, &about);
        let half = Image { data: result.white.data.iter().map(|v| 0.5 * v).collect(), ..result.white.clone() };
        let captures = [("white.png".to_owned(), result.white.clone()), ("stripes.png".to_owned(), half)];
        let page = Page {
            surface: &result,
            summary: &summary,
            metrics: Some(&metrics),
            trace: None,
            captures: &captures,
            black: None,
            truth: Some(&truth),
        };
        let html = page.html();
        for outside in ["http://", "https://", "@import", "src=\"/", "<link"] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert!(!html.contains("{{") && !html.contains("<ball>") && html.contains("&lt;ball&gt;"));
        assert!(html.contains("guess &amp; &lt;check&gt;"));
        assert!(html.len() < 4_000_000, "{} bytes", html.len());
        for shown in [
            "Depth",
            "Error",
            "Normals",
            "1σ",
            "Residual",
            "Left out",
            "grazing",
            "white.png",
            "Normalized",
            "Loss",
            "calibrated",
            "Gaussian",
            "stripes.png",
        ] {
            assert!(html.contains(shown), "{shown}");
        }
    }

    #[test]
    fn losses_of_every_method_are_found() {
        let of = |v: Value| losses(&serde_json::json!({ "losses": v }));
        assert_eq!(of(serde_json::json!([3.0, 2.0, 1.0]))[0].points, [[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]]);
        let record =
            |i: i32, image: f64| serde_json::json!({ "iteration": i, "image": image, "eikonal": 0.5, "rays": 7 });
        let several = of(serde_json::json!([record(1, 0.5), record(101, 0.25)]));
        assert_eq!(several.iter().map(|s| s.label.as_str()).collect::<Vec<_>>(), ["image", "eikonal"]);
        assert_eq!(several[0].points, [[1.0, 0.5], [101.0, 0.25]]);
        assert!(of(Value::Null).is_empty() && of(serde_json::json!([1.0])).is_empty());
    }

    #[test]
    fn sigmas_have_their_shares() {
        for (n, share) in [(0.0, 0.0), (1.0, 0.682_689_5), (2.0, 0.954_499_7), (3.0, 0.997_300_2)] {
            assert!((within_sigmas(n) - share).abs() < 1e-6, "{n}");
        }
        // Errors of one σ everywhere: a step from nothing to all.
        let (mut result, _, truth) = ball();
        result.depth = truth.depth.iter().map(|z| z + 0.2).collect();
        result.sigma = vec![0.19; truth.depth.len()];
        let chart = calibration(&result, &truth).unwrap();
        let measured = &chart.series[0].points;
        assert_eq!((measured[10][1], measured[11][1]), (0.0, 1.0));
    }
}
