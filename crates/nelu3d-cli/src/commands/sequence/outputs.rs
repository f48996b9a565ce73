//! What a finished sequence is besides its frames: one table, one moving surface, one preview.

use std::fmt;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context as _, Result};
use nelu3d::result::SavedResult;
use nelu3d::result::picture::{DEPTH_COLORS, Picture, color_at};
use nelu3d_scan::Mesh;
use nelu3d_scan::image::Apng;
use nelu3d_scan::mesh::AnimatedGlb;
use nelu3d_scan::output::{create_dir, write_atomic};
use nelu3d_scan::rig::Shot;
use nelu3d_scan::statistics::percentile;
use serde_json::{Value, json};

use super::super::shown;
use super::folder::Folder;

/// The moving surface.
pub(super) const ANIMATION: &str = "animation.glb";
/// The moving picture.
pub(super) const PREVIEW: &str = "preview.png";
/// Folder of all surfaces, numbered.
pub(super) const MESHES: &str = "meshes";
/// Everything in numbers.
const TABLE: &str = "sequence.json";

/// One line per frame.
pub(super) struct Table(Vec<Row>);

struct Row {
    frame: String,
    /// `None` if it failed.
    summary: Option<Value>,
    failure: Option<String>,
}

/// Writes everything that spans frames; all of them are done or have failed.
pub(super) fn write(folder: &Folder, frames: &[Shot], fps: f64) -> Result<Table> {
    let mut rows = Vec::with_capacity(frames.len());
    for frame in frames {
        let summary = folder.is_done(frame).then(|| folder.summary(frame)).transpose()?;
        rows.push(Row { frame: frame.name.clone(), summary, failure: folder.failure(frame) });
    }
    let table = Table(rows);
    let done: Vec<&Shot> = frames.iter().filter(|f| folder.is_done(f)).collect();
    meshes(folder, &done)?;
    animation(folder, &done, &table, fps)?;
    preview(folder, &done, &table, fps)?;
    let json = json!({ "fps": fps, "mean": table.mean(), "frames": table.json() });
    write_atomic(&folder.root().join(TABLE), |w| Ok(serde_json::to_writer_pretty(w, &json)?))?;
    Ok(table)
}

/// The frames' meshes in one folder, as programs that open numbered files want them. They are links to the files in the frames' folders
/// where the disk has such.
fn meshes(folder: &Folder, frames: &[&Shot]) -> Result<()> {
    let dir = folder.root().join(MESHES);
    create_dir(&dir)?;
    for (i, frame) in frames.iter().enumerate() {
        let (from, to) = (folder.frame(frame).join("mesh.ply"), dir.join(format!("{i:04}.ply")));
        link(&from, &to).with_context(|| format!("{}: cannot be written", shown(&to)))?;
    }
    Ok(())
}

/// The moving surface. A binary glTF holds 4 GiB at most; of a sequence too large for it, vertices are merged until it fits.
fn animation(folder: &Folder, frames: &[&Shot], table: &Table, fps: f64) -> Result<()> {
    let bytes = 28.0 * table.numbers("/mesh/vertices").sum::<f64>() + 12.0 * table.numbers("/mesh/faces").sum::<f64>();
    let cells = (bytes / MOST_BYTES).sqrt();
    let mut out = AnimatedGlb::new(fps);
    for frame in frames {
        let path = folder.frame(frame).join("mesh.ply");
        let mesh = Mesh::read(&path)?;
        out.push(&if cells > 1.0 { merged(&mesh, cells) } else { mesh })?;
    }
    Ok(out.write(&folder.root().join(ANIMATION))?)
}

/// Largest animation, bytes: what viewers open without trouble.
const MOST_BYTES: f64 = 1.5e9;

/// The mesh with all vertices in a cube of `cells` times its typical edge merged into their mean.
fn merged(mesh: &Mesh, cells: f64) -> Mesh {
    let edge = |f: &[u32; 3]| {
        let (a, b) = (mesh.vertices[f[0] as usize], mesh.vertices[f[1] as usize]);
        (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt()
    };
    let mut edges: Vec<f32> = mesh.faces.iter().step_by(mesh.faces.len() / 1000 + 1).map(edge).collect();
    if edges.is_empty() {
        return mesh.clone();
    }
    edges.sort_by(f32::total_cmp);
    let side = edges[edges.len() / 2].max(1e-6) * cells as f32;
    let mut index = std::collections::HashMap::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let of: Vec<u32> = mesh
        .vertices
        .iter()
        .enumerate()
        .map(|(i, v)| {
            let slot = *index.entry(v.map(|c| (c / side).floor() as i64)).or_insert_with(|| {
                groups.push(Vec::new());
                groups.len() - 1
            });
            groups[slot].push(i);
            slot as u32
        })
        .collect();
    let mean = |values: &[[f32; 3]], group: &[usize]| -> [f32; 3] {
        std::array::from_fn(|c| group.iter().map(|i| values[*i][c]).sum::<f32>() / group.len() as f32)
    };
    let unit = |v: [f32; 3]| {
        let length = v.iter().map(|c| c * c).sum::<f32>().sqrt().max(1e-12);
        v.map(|c| c / length)
    };
    let each = |values: &[[f32; 3]]| groups.iter().map(|g| mean(values, g)).collect::<Vec<_>>();
    Mesh {
        vertices: each(&mesh.vertices),
        normals: if mesh.normals.is_empty() { Vec::new() } else { each(&mesh.normals).into_iter().map(unit).collect() },
        colors: if mesh.colors.is_empty() { Vec::new() } else { groups.iter().map(|g| mesh.colors[g[0]]).collect() },
        faces: mesh
            .faces
            .iter()
            .map(|f| f.map(|i| of[i as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect(),
    }
}

/// The moving picture: the surface as clay in the colors of its depth, one scale for all frames.
fn preview(folder: &Folder, frames: &[&Shot], table: &Table, fps: f64) -> Result<()> {
    // A single pixel far off in one frame does not spread the colors of all.
    let middle = |path: &str| percentile(&mut table.numbers(path).collect::<Vec<_>>(), 50.0);
    let range = [middle("/depth_mm/min"), middle("/depth_mm/max")];
    let mut out = None;
    for frame in frames {
        let saved = SavedResult::read(&folder.frame(frame))?;
        let normals = saved.normals.with_context(|| format!("{}: has no normals.npy", shown(&folder.frame(frame))))?;
        // Near is bright.
        let color = |i: usize| color_at(DEPTH_COLORS, range[0] + range[1] - f64::from(saved.depth[i]), range);
        let picture = Picture::shaded(&normals, saved.camera.width, saved.camera.height, color).at_most(640);
        let [w, h] = picture.size();
        if out.is_none() {
            out = Some(Apng::create(&folder.root().join(PREVIEW), w, h, frames.len(), fps)?);
        }
        let pixels: Vec<u8> = (0..w * h).flat_map(|i| picture.rgb(i)).collect();
        out.as_mut().expect("just made").push(&pixels)?;
    }
    out.map_or(Ok(()), |out| Ok(out.finish()?))
}

/// A link, or where the disk has none a copy. Another task may be doing the same: who comes second finds it done.
fn link(from: &Path, to: &Path) -> std::io::Result<()> {
    match std::fs::remove_file(to) {
        Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    match std::fs::hard_link(from, to) {
        Err(e) if e.kind() != ErrorKind::AlreadyExists => {
            write_atomic(to, |w| std::io::copy(&mut std::fs::File::open(from)?, w).map(|_| ()))
        }
        _ => Ok(()),
    }
}

impl Row {
    fn number(&self, path: &str) -> Option<f64> {
        self.summary.as_ref()?.pointer(path)?.as_f64()
    }

    fn json(&self) -> Value {
        json!({
            "frame": self.frame,
            "failed": self.failure,
            "kept": self.number("/pixels/kept"),
            "start": self.summary.as_ref().and_then(|s| s.pointer("/method/start")),
            "motion": self.summary.as_ref().and_then(|s| s.pointer("/method/motion")),
            "cpu_secs": self.number("/cpu_secs"),
            "wall_secs": self.number("/wall_secs"),
            "metrics": self.summary.as_ref().and_then(|s| s.get("metrics")),
        })
    }
}

impl Table {
    /// Means over the frames of every number in their rows.
    pub(super) fn mean(&self) -> Value {
        let rows: Vec<Value> = self.0.iter().filter(|r| r.summary.is_some()).map(Row::json).collect();
        mean(&rows.iter().collect::<Vec<_>>())
    }

    /// A number of every frame's result.json.
    fn numbers<'a>(&'a self, path: &'a str) -> impl Iterator<Item = f64> + 'a {
        self.0.iter().filter_map(move |row| row.number(path))
    }

    /// One object per frame.
    pub(super) fn json(&self) -> Value {
        self.0.iter().map(Row::json).collect()
    }
}

/// Means of numbers, key by key; of what is no number in some row, nothing.
fn mean(rows: &[&Value]) -> Value {
    if let Some(Value::Object(first)) = rows.first() {
        let of = |key: &String| -> Value {
            let values: Vec<&Value> = rows.iter().filter_map(|r| r.get(key)).collect();
            if values.len() == rows.len() { mean(&values) } else { Value::Null }
        };
        return first.keys().map(|key| (key.clone(), of(key))).filter(|(_, v)| !v.is_null()).collect();
    }
    let numbers: Vec<f64> = rows.iter().filter_map(|v| v.as_f64()).collect();
    if numbers.is_empty() || numbers.len() < rows.len() {
        return Value::Null;
    }
    json!(numbers.iter().sum::<f64>() / numbers.len() as f64)
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let judged = self.0.iter().any(|r| r.number("/metrics/whole/depth_mm/mae").is_some());
        write!(f, "frame         pixels  start  px/frame   time   CPU s")?;
        writeln!(f, "{}", if judged { "  coverage  MAE mm  median  body MAE  median" } else { "" })?;
        for row in &self.0 {
            if let (None, Some(why)) = (&row.summary, &row.failure) {
                writeln!(f, "{:<12}  failed: {why}", row.frame)?;
                continue;
            }
            let warm = row.number("/method/start/found_anew").is_some();
            let show = |path: &str, digits: usize| row.number(path).map_or("–".into(), |v| format!("{v:.digits$}"));
            write!(
                f,
                "{:<12}  {:>6}  {:<5}  {:>8}  {:>5}  {:>6}",
                row.frame,
                show("/pixels/kept", 0),
                if warm { "warm" } else { "cold" },
                show("/method/motion/speed_px", 2),
                show("/method/motion/pattern_time/frames", 2),
                show("/cpu_secs", 2),
            )?;
            if judged {
                let coverage =
                    row.number("/metrics/whole/coverage").map_or("–".into(), |v| format!("{:.1} %", 100.0 * v));
                write!(
                    f,
                    "  {coverage:>8}  {:>6}  {:>6}  {:>8}  {:>6}",
                    show("/metrics/whole/depth_mm/mae", 3),
                    show("/metrics/whole/depth_mm/median", 3),
                    show("/metrics/body/depth_mm/mae", 3),
                    show("/metrics/body/depth_mm/median", 3),
                )?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat sheet of unit squares: merged twice as coarse it is still that sheet, with a quarter of the vertices.
    #[test]
    fn merging_keeps_the_surface() {
        let n = 20usize;
        let vertices: Vec<[f32; 3]> = (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 500.0]).collect();
        let square = |i: u32| [[i, i + 1, i + n as u32], [i + 1, i + 1 + n as u32, i + n as u32]];
        let corner = |i: &usize| i % n + 1 < n && i / n + 1 < n;
        let faces: Vec<[u32; 3]> = (0..n * n).filter(corner).flat_map(|i| square(i as u32)).collect();
        let normals = vec![[0.0, 0.0, -1.0]; n * n];
        let colors = (0..n * n).map(|i| [i as u8, 0, 0]).collect();
        let small = merged(&Mesh { vertices, normals, colors, faces }, 2.0);
        assert_eq!(small.vertices.len(), n * n / 4);
        assert_eq!((small.normals.len(), small.colors.len()), (n * n / 4, n * n / 4));
        assert!(small.vertices.iter().all(|v| v[2] == 500.0) && small.normals.iter().all(|n| *n == [0.0, 0.0, -1.0]));
        let area: f32 = small
            .faces
            .iter()
            .map(|f| {
                let [a, b, c] = f.map(|i| small.vertices[i as usize]);
                0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
            })
            .sum();
        assert!((area - 18.0 * 18.0).abs() < 1e-3, "{area}");
    }

    #[test]
    fn means_are_of_numbers_that_all_rows_have() {
        let rows =
            [json!({"a": 1.0, "b": {"c": 2}, "d": "x", "e": 5}), json!({"a": 3.0, "b": {"c": 4}, "d": "y", "e": null})];
        assert_eq!(mean(&rows.iter().collect::<Vec<_>>()), json!({"a": 2.0, "b": {"c": 3.0}}));
    }
}
