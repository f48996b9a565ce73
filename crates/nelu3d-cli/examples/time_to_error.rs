//! Time-to-error curves of the reconstruction: error against processor time, per scene, effort and seed.
//!
//! ```text
//! cargo run --release -p nelu3d-cli --example time_to_error -- OUT RIG:SCENE:FIELD…
//! ```
//!
//! Runs `nelu3d reconstruct --trace` with every effort and seeds 0, 1, 2, and writes OUT/curves.csv (every point),
//! OUT/table.md (one line per scene and effort) and OUT/time-to-error.svg. The program must have been built
//! (`cargo build --release`). FIELD is the color field of the rig: calibration is no part of the curves. Runs that OUT
//! already holds are not repeated.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use serde_json::Value;

const EFFORTS: [(&str, &str); 3] = [("quick", "#e69f00"), ("normal", "#0072b2"), ("best", "#009e73")];
const SEEDS: [u64; 3] = [0, 1, 2];

/// One finished run.
struct Run {
    effort: usize,
    seed: u64,
    summary: Value,
}

impl Run {
    /// `[cpu_secs, mae, body_median]` of every point.
    fn points(&self) -> Vec<[f64; 3]> {
        let get = |p: &Value, key: &str| p[key].as_f64().unwrap_or(f64::NAN);
        let all = self.summary["trace"].as_array().map_or(&[][..], Vec::as_slice);
        all.iter().map(|p| [get(p, "cpu_secs"), get(p, "mae"), get(p, "body_median")]).collect()
    }

    fn metric(&self, path: &str) -> f64 {
        self.summary.pointer(path).and_then(Value::as_f64).unwrap_or(f64::NAN)
    }
}

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let out = PathBuf::from(args.next().context("usage: time_to_error OUT RIG:SCENE:FIELD…")?);
    std::fs::create_dir_all(&out)?;
    // examples/time_to_error lies beside the program's folder.
    let program = std::env::current_exe()?.parent().and_then(Path::parent).context("no target folder")?.join("nelu3d");
    let mut scenes = Vec::new();
    for job in args {
        let [rig, scene, field] = job.split(':').collect::<Vec<_>>()[..] else { bail!("{job}: not RIG:SCENE:FIELD") };
        let mut runs = Vec::new();
        for (effort, (name, _)) in EFFORTS.iter().enumerate() {
            for seed in SEEDS {
                let result = out.join(format!("{scene}-{name}-{seed}"));
                let done = result.join("result.json");
                if done.is_file() {
                    runs.push(Run { effort, seed, summary: serde_json::from_str(&std::fs::read_to_string(done)?)? });
                    continue;
                }
                let status = Command::new(&program)
                    .args(["reconstruct", rig, scene, "--quiet", "--trace", "--effort", name, "--field", field])
                    .args(["--seed", &seed.to_string(), "--truth", &format!("{rig}/scenes/{scene}/truth"), "-o"])
                    .arg(&result)
                    .stdout(std::process::Stdio::null())
                    .status()
                    .with_context(|| format!("{}", program.display()))?;
                if !status.success() {
                    bail!("{job}: nelu3d failed");
                }
                let summary = serde_json::from_str(&std::fs::read_to_string(done)?)?;
                runs.push(Run { effort, seed, summary });
            }
        }
        scenes.push((scene.to_owned(), runs));
    }
    std::fs::write(out.join("curves.csv"), csv(&scenes))?;
    std::fs::write(out.join("table.md"), table(&scenes))?;
    std::fs::write(out.join("time-to-error.svg"), svg(&scenes))?;
    print!("{}", table(&scenes));
    Ok(())
}

fn csv(scenes: &[(String, Vec<Run>)]) -> String {
    let mut text =
        "scene,effort,seed,stage,iteration,cpu_secs,coverage,mae_mm,rmse_mm,bias_mm,body_median_mm\n".to_owned();
    for (scene, runs) in scenes {
        for run in runs {
            for p in run.summary["trace"].as_array().into_iter().flatten() {
                let _ = writeln!(
                    text,
                    "{scene},{},{},{},{},{},{},{},{},{},{}",
                    EFFORTS[run.effort].0,
                    run.seed,
                    p["stage"].as_str().unwrap_or_default(),
                    p["iteration"],
                    p["cpu_secs"],
                    p["coverage"],
                    p["mae"],
                    p["rmse"],
                    p["bias"],
                    p["body_median"]
                );
            }
        }
    }
    text
}

/// Mean over the seeds, and the largest distance from it where there is any.
fn over_seeds(values: &[f64], digits: usize) -> String {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let off = values.iter().map(|v| (v - mean).abs()).fold(0.0, f64::max);
    let shown = format!("{off:.digits$}");
    if shown.parse::<f64>().is_ok_and(|v| v > 0.0) {
        format!("{mean:.digits$} ± {shown}")
    } else {
        format!("{mean:.digits$}")
    }
}

fn table(scenes: &[(String, Vec<Run>)]) -> String {
    let mut text = "| scene | effort | CPU s | MAE mm | RMSE mm | coverage % | body median mm | bias mm | peak MB |\n\
                    |---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for (scene, runs) in scenes {
        for (effort, (name, _)) in EFFORTS.iter().enumerate() {
            let runs: Vec<&Run> = runs.iter().filter(|r| r.effort == effort).collect();
            let of = |f: &dyn Fn(&Run) -> f64| runs.iter().map(|r| f(r)).collect::<Vec<f64>>();
            let metric = |path: &'static str| of(&|r| r.metric(path));
            let percent = metric("/metrics/whole/coverage").iter().map(|v| 100.0 * v).collect::<Vec<_>>();
            let memory = metric("/peak_memory_bytes").iter().map(|v| v / 1e6).collect::<Vec<_>>();
            let _ = writeln!(
                text,
                "| {scene} | {name} | {} | {} | {} | {} | {} | {} | {} |",
                over_seeds(&of(&|r| r.points().last().map_or(f64::NAN, |p| p[0])), 1),
                over_seeds(&metric("/metrics/whole/depth_mm/mae"), 3),
                over_seeds(&metric("/metrics/whole/depth_mm/rmse"), 3),
                over_seeds(&percent, 1),
                over_seeds(&metric("/metrics/body/depth_mm/median"), 3),
                over_seeds(&metric("/metrics/body/depth_mm/bias"), 3),
                over_seeds(&memory, 0)
            );
        }
    }
    text
}

/// Two rows of panels, MAE and body median, one column per scene; both axes logarithmic.
fn svg(scenes: &[(String, Vec<Run>)]) -> String {
    const W: f64 = 300.0;
    const H: f64 = 220.0;
    let width = 60.0 + scenes.len() as f64 * (W + 60.0);
    let mut s = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {}' font-family='sans-serif' font-size='12'>\n\
         <rect width='100%' height='100%' fill='white'/>\n",
        2.0 * (H + 70.0) + 40.0
    );
    for (i, (name, color)) in EFFORTS.iter().enumerate() {
        let x = 60.0 + 110.0 * i as f64;
        let _ = writeln!(
            s,
            "<rect x='{x}' y='8' width='16' height='4' fill='{color}'/><text x='{}' y='14'>{name}</text>",
            x + 22.0
        );
    }
    for (column, (scene, runs)) in scenes.iter().enumerate() {
        for (row, what) in ["MAE, mm", "body median, mm"].iter().enumerate() {
            let (x0, y0) = (60.0 + column as f64 * (W + 60.0), 50.0 + row as f64 * (H + 70.0));
            let values: Vec<[f64; 2]> = runs.iter().flat_map(Run::points).map(|p| [p[0], p[1 + row]]).collect();
            let span = |j: usize| {
                let (lo, hi) = values.iter().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v[j]), h.max(v[j])));
                (lo / 1.1, hi * 1.1)
            };
            let ((tl, th), (el, eh)) = (span(0), span(1));
            let x = |t: f64| x0 + W * (t / tl).ln() / (th / tl).ln();
            let y = |e: f64| y0 + H - H * (e / el).ln() / (eh / el).ln();
            let _ = writeln!(s, "<rect x='{x0}' y='{y0}' width='{W}' height='{H}' fill='none' stroke='#888'/>");
            let _ = writeln!(s, "<text x='{x0}' y='{}'>{scene}: {what}</text>", y0 - 6.0);
            for tick in ticks(tl, th) {
                let at = x(tick);
                let _ = writeln!(
                    s,
                    "<line x1='{at:.1}' x2='{at:.1}' y1='{y0}' y2='{}' stroke='#e4e4e4'/>\
                     <text x='{at:.1}' y='{}' text-anchor='middle'>{tick}</text>",
                    y0 + H,
                    y0 + H + 15.0
                );
            }
            for tick in ticks(el, eh) {
                let at = y(tick);
                let _ = writeln!(
                    s,
                    "<line x1='{x0}' x2='{}' y1='{at:.1}' y2='{at:.1}' stroke='#e4e4e4'/>\
                     <text x='{}' y='{:.1}' text-anchor='end'>{tick}</text>",
                    x0 + W,
                    x0 - 5.0,
                    at + 4.0
                );
            }
            let _ = writeln!(s, "<text x='{}' y='{}' text-anchor='end'>CPU s</text>", x0 + W, y0 + H + 30.0);
            for run in runs {
                let points = run.points().iter().fold(String::new(), |mut text, p| {
                    let _ = write!(text, "{:.1},{:.1} ", x(p[0]), y(p[1 + row]));
                    text
                });
                let color = EFFORTS[run.effort].1;
                let _ = writeln!(s, "<polyline points='{points}' fill='none' stroke='{color}' stroke-width='1.5'/>");
            }
        }
    }
    s + "</svg>\n"
}

/// 1, 2 and 5 times powers of ten between two values.
fn ticks(lo: f64, hi: f64) -> Vec<f64> {
    (-4..5)
        .flat_map(|e| [1.0, 2.0, 5.0].map(|m| format!("{m}e{e}").parse::<f64>().expect("a number")))
        .filter(|t| (lo..=hi).contains(t))
        .collect()
}
