//! `report.html`: one page that shows a result, readable offline, on a phone, by somebody without this program.

mod mesh;

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use colorous::Gradient;
use nelu3d::evaluate::{Metrics, Truth, percentile};
use nelu3d::result::picture::{DEPTH_COLORS, Picture, left_color, limits};
use nelu3d::result::{Left, Reconstruction, Summary};
use nelu3d_scan::Image;
use serde_json::Value;

/// Pictures of maps are at most this wide, so that the page stays small.
const MAP_WIDTH: usize = 640;
/// The same for captures.
const CAPTURE_WIDTH: usize = 320;

const TEMPLATE: &str = include_str!("template.html");
const STYLE: &str = include_str!("style.css");
const VIEWER: &str = include_str!("viewer.js");

/// What a page shows.
pub(crate) struct Page<'a> {
    /// The result.
    pub result: &'a Reconstruction,
    /// What its `result.json` says.
    pub summary: &'a Summary,
    /// The captures it was made from, with their names; white first.
    pub captures: &'a [(String, Image)],
    /// The truth, when there is one.
    pub truth: Option<&'a Truth>,
}

impl Page<'_> {
    /// The page.
    pub(crate) fn html(&self) -> String {
        let s = self.summary;
        let title = format!("{} · {}", s.scene, s.set);
        let subtitle = format!(
            "rig {} · {} × {} px · nelu3d {} · {} {}",
            s.rig_name, self.result.width, self.result.height, s.version, s.machine.os, s.machine.arch
        );
        let mesh = serde_json::to_string(&mesh::PageMesh::of(&self.result.mesh)).expect("plain data");
        let parts = [
            ("title", escape(&title)),
            ("subtitle", escape(&subtitle)),
            ("style", STYLE.to_owned()),
            ("tiles", self.tiles()),
            ("maps", self.maps()),
            ("captures", self.captures()),
            ("metrics", s.metrics.as_ref().map(metrics_table).unwrap_or_default()),
            ("left", left_table(s)),
            ("stages", stages_table(s)),
            ("method", value_table(&s.method)),
            ("inputs", inputs_table(s)),
            ("viewer", VIEWER.to_owned()),
            ("mesh", mesh),
        ];
        fill(TEMPLATE, &parts)
    }

    /// The numbers one looks for first.
    fn tiles(&self) -> String {
        let s = self.summary;
        let mut tiles = vec![
            (grouped(s.pixels.kept), "points".to_owned()),
            (percent(s.pixels.kept as f64 / s.pixels.total as f64), "of all pixels".to_owned()),
            (with_unit(s.depth_mm.median_sigma, 2, "mm"), "median 1σ of depth".to_owned()),
        ];
        if let Some(m) = &s.metrics {
            tiles.push((with_unit(m.body.depth_mm.median, 2, "mm"), "median error, body".to_owned()));
            tiles.push((with_unit(m.whole.depth_mm.mae, 2, "mm"), "mean error, whole".to_owned()));
        }
        tiles.push((with_unit(s.wall_secs, 1, "s"), format!("time ({:.1} CPU s)", s.cpu_secs)));
        if let Some(bytes) = s.peak_memory_bytes {
            tiles.push((format!("{:.0} MB", bytes as f64 / 1e6), "peak memory".to_owned()));
        }
        tiles.iter().fold(String::new(), |mut html, (number, label)| {
            let _ = write!(html, "<div class=tile><b>{}</b><span>{}</span></div>", escape(number), escape(label));
            html
        })
    }

    fn maps(&self) -> String {
        let r = self.result;
        let (w, h) = (r.width, r.height);
        let mut html = String::new();
        let mut add = |name: &str, note: &str, picture: Picture, legend: String| {
            let _ = write!(
                html,
                "<figure><figcaption><b>{}</b> <span>{}</span></figcaption>{}{legend}</figure>",
                escape(name),
                escape(note),
                img(&picture.at_most(MAP_WIDTH), name)
            );
        };

        // Near is bright, as in the preview.
        let [near, far] = limits(&r.depth, 1.0, 99.0);
        let nearness: Vec<f32> = r.depth.iter().map(|&z| (near + far) as f32 - z).collect();
        let picture = Picture::of_map(&nearness, w, h, [near, far], DEPTH_COLORS);
        add("Depth", "camera z", picture, color_bar(DEPTH_COLORS, [far, near], "mm"));

        if let Some(truth) = self.truth {
            let error: Vec<f32> =
                (0..w * h).map(|i| if truth.mask[i] { r.depth[i] - truth.depth[i] } else { f32::NAN }).collect();
            let magnitudes: Vec<f64> = error.iter().filter(|e| e.is_finite()).map(|&e| f64::from(e).abs()).collect();
            let p95 = percentile(magnitudes, 95.0);
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
        add("Left out", "why pixels have no depth", Picture::of_left(&r.left, w, h), left_legend());
        html
    }

    fn captures(&self) -> String {
        self.captures.iter().fold(String::new(), |mut html, (name, capture)| {
            let picture = Picture::of_image(capture).at_most(CAPTURE_WIDTH);
            let _ = write!(html, "<figure>{}<figcaption>{}</figcaption></figure>", img(&picture, name), escape(name));
            html
        })
    }
}

fn metrics_table(metrics: &Metrics) -> String {
    let legend = "<p class=note>whole: everything the light source and the camera both see. body: without 3 px next to \
                  silhouettes, shadow borders and depth jumps. grazing: seen at more than 70°. Errors are over the \
                  pixels that have a depth; bias is ours − truth.</p>";
    let table = table(&metrics.headings(), &metrics.rows());
    format!("<section><h2>Error against the truth</h2>{table}{legend}</section>")
}

fn left_table(s: &Summary) -> String {
    let count = |l: Left| match l {
        Left::Kept => s.pixels.kept as u64,
        _ => s.pixels.left[l.key()].as_u64().unwrap_or(0),
    };
    let rows: Vec<Vec<String>> = Left::ALL
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

/// Whatever the method put on record, one line a value; long lists of numbers as curves.
fn value_table(values: &serde_json::Map<String, Value>) -> String {
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
    lines("", &Value::Object(values.clone()), &mut out);
    format!("<div class=scroll><table class=values>{out}</table></div>")
}

/// A small curve of a list of numbers, as SVG.
fn curve(values: &[f64]) -> String {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let span = if high > low { high - low } else { 1.0 };
    let points = values.iter().enumerate().fold(String::new(), |mut s, (i, v)| {
        let x = 240.0 * i as f64 / (values.len() - 1) as f64;
        let _ = write!(s, "{x:.1},{:.1} ", 38.0 - 36.0 * (v - low) / span);
        s
    });
    format!(
        "<svg viewBox='0 0 240 40' class=curve><polyline points='{points}'/></svg> <span class=note>{} values, {} … \
         {}</span>",
        values.len(),
        short(low),
        short(high)
    )
}

fn table<S: AsRef<str>>(headings: &[&str], rows: &[Vec<S>]) -> String {
    let mut html = "<div class=scroll><table><tr>".to_owned();
    for h in headings {
        let _ = write!(html, "<th>{}</th>", escape(h));
    }
    html.push_str("</tr>");
    for row in rows {
        html.push_str("<tr>");
        for cell in row {
            let _ = write!(html, "<td>{}</td>", escape(cell.as_ref()));
        }
        html.push_str("</tr>");
    }
    html.push_str("</table></div>");
    html
}

/// A bar of colors with five labels, `range[0]` at the left in the gradient's first color unless the range is reversed.
fn color_bar(gradient: Gradient, range: [f64; 2], unit: &str) -> String {
    let stops: Vec<String> =
        (0..=16).map(|i| gradient.eval_continuous(f64::from(i) / 16.0)).map(|c| format!("#{c:x}")).collect();
    let labels = (0..5).fold(String::new(), |mut s, i| {
        let v = range[0] + (range[1] - range[0]) * f64::from(i) / 4.0;
        let unit = if i == 4 && !unit.is_empty() { format!(" {unit}") } else { String::new() };
        let _ = write!(s, "<span>{}{}</span>", short(v), escape(&unit));
        s
    });
    format!(
        "<div class=bar style='background:linear-gradient(to right,{})'></div><div class=ticks>{labels}</div>",
        stops.join(",")
    )
}

fn left_legend() -> String {
    let items = Left::ALL.iter().fold(String::new(), |mut s, &l| {
        let [r, g, b] = left_color(l);
        let _ = write!(s, "<span><i style='background:rgb({r},{g},{b})'></i>{}</span>", escape(l.label()));
        s
    });
    format!("<div class=legend>{items}</div>")
}

fn img(picture: &Picture, alt: &str) -> String {
    let [w, h] = picture.size();
    let data = STANDARD.encode(picture.png());
    format!("<img width={w} height={h} alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(alt))
}

/// Replaces each `{{name}}` of a template, in one pass: what is put in is not looked at again.
fn fill(template: &str, parts: &[(&str, String)]) -> String {
    let mut out = String::with_capacity(template.len() + parts.iter().map(|p| p.1.len()).sum::<usize>());
    let mut rest = template;
    while let Some(start) = rest.find("{{") {
        let end = start + rest[start..].find("}}").expect("the template closes its braces");
        let name = &rest[start + 2..end];
        out.push_str(&rest[..start]);
        out.push_str(&parts.iter().find(|p| p.0 == name).expect("the template's names are known").1);
        rest = &rest[end + 2..];
    }
    out + rest
}

fn escape(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut s, c| {
        match c {
            '&' => s.push_str("&amp;"),
            '<' => s.push_str("&lt;"),
            '>' => s.push_str("&gt;"),
            '"' => s.push_str("&quot;"),
            '\'' => s.push_str("&#39;"),
            c => s.push(c),
        }
        s
    })
}

/// A number in few characters.
fn short(v: f64) -> String {
    match v.abs() {
        a if !v.is_finite() => format!("{a}"),
        0.0 => "0".to_owned(),
        100.0.. => format!("{v:.0}"),
        10.0.. => format!("{v:.1}"),
        0.1.. => format!("{v:.2}"),
        0.01.. => format!("{v:.3}"),
        0.001.. => format!("{v:.4}"),
        _ => format!("{v:.1e}"),
    }
}

fn with_unit(v: f64, digits: usize, unit: &str) -> String {
    if v.is_finite() { format!("{v:.digits$} {unit}") } else { "–".to_owned() }
}

fn percent(v: f64) -> String {
    with_unit(100.0 * v, 1, "%")
}

/// Digits in groups of three.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use nelu3d::evaluate::{Judged, evaluate};
    use nelu3d::result::{About, StageTime};
    use nelu3d_scan::{Camera, Mesh};

    /// A ball of 100 mm before a wall, seen by a small camera, as its own truth plus a ripple of 0.2 mm.
    fn ball() -> (Reconstruction, Camera, Truth) {
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
        let truth = Truth { width, height, depth: depth.clone(), mask: vec![true; n] };
        let mut left = vec![Left::Kept; n];
        for i in 0..n {
            depth[i] += 0.2 * ((i % width) as f32 * 0.2).sin();
            if i % width < 20 {
                left[i] = if i / width < 120 { Left::Dark } else { Left::Edge };
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
        let result = Reconstruction {
            width,
            height,
            sigma: depth.iter().map(|z| 0.0002 * z).collect(),
            residual: depth.iter().map(|z| 0.01 + 0.0 * z).collect(),
            ambient: depth.iter().map(|z| 0.1 + 0.0 * z).collect(),
            depth,
            normals,
            left,
            white,
            mesh: Mesh { vertices, normals: Vec::new(), colors, faces },
            stages: vec![StageTime { name: "guess & <check>".to_owned(), wall_secs: 1.5, cpu_secs: 2.5 }],
            info: serde_json::json!({
                "seed": 7,
                "losses": { "image": (0..200).map(|i| (-0.02 * f64::from(i)).exp()).collect::<Vec<_>>() },
            })
            .as_object()
            .unwrap()
            .clone(),
        };
        (result, camera, truth)
    }

    #[test]
    fn a_page_needs_nothing_else_and_is_small() {
        let (result, camera, truth) = ball();
        let judged = Judged { depth: &result.depth, normals: Some(&result.normals), sigma: Some(&result.sigma) };
        let metrics = evaluate(&judged, &truth, &truth.regions(&camera), &camera, None);
        let about = About { scene: "<ball>".to_owned(), metrics: Some(metrics), ..About::default() };
        let summary = Summary::new(&result, &camera, &about);
        let captures = [("white.png".to_owned(), result.white.clone())];
        let html = Page { result: &result, summary: &summary, captures: &captures, truth: Some(&truth) }.html();
        for outside in ["http://", "https://", "@import", "src=\"/", "<link"] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert!(!html.contains("{{") && !html.contains("<ball>") && html.contains("&lt;ball&gt;"));
        assert!(html.contains("guess &amp; &lt;check&gt;"));
        assert!(html.len() < 4_000_000, "{} bytes", html.len());
        for shown in ["Depth", "Error", "Normals", "1σ", "Residual", "Left out", "grazing", "white.png"] {
            assert!(html.contains(shown), "{shown}");
        }
    }

    #[test]
    fn what_is_put_in_is_not_filled_again() {
        let parts = [("a", "{{b}}".to_owned()), ("b", "B".to_owned())];
        assert_eq!(fill("<{{a}}|{{b}}>", &parts), "<{{b}}|B>");
    }

    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(escape("<b x='1'>\"&"), "&lt;b x=&#39;1&#39;&gt;&quot;&amp;");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!([short(0.0), short(523.4), short(-0.5), short(2e-5)], ["0", "523", "-0.50", "2.0e-5"]);
    }
}
