//! What spans the frames of a finished sequence: one table, one moving surface, one preview.

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
use serde_json::json;

use super::folder::SequenceFolder;
use super::frame_table::SequenceTable;
use super::merge::merge_vertices;
use crate::paths::shown;

/// File of the moving surface.
pub(super) const ANIMATION: &str = "animation.glb";
/// File of the moving picture.
pub(super) const PREVIEW: &str = "preview.png";
/// Folder of all surfaces, numbered.
pub(super) const MESHES: &str = "meshes";
/// File of the table.
const TABLE: &str = "sequence.json";

/// Maximum size of an animation that viewers open without trouble, bytes.
const MAX_BYTES: f64 = 1.5e9;

/// Writes everything that spans frames; all of them are done or have failed.
pub(super) fn write(folder: &SequenceFolder, frames: &[Shot], fps: f64) -> Result<SequenceTable> {
    let table = SequenceTable::read(folder, frames)?;
    let done: Vec<&Shot> = frames.iter().filter(|f| folder.is_done(f)).collect();
    meshes(folder, &done)?;
    animation(folder, &done, &table, fps)?;
    preview(folder, &done, &table, fps)?;
    let json = json!({ "fps": fps, "mean": table.mean(), "frames": table.json() });
    write_atomic(&folder.root().join(TABLE), |w| Ok(serde_json::to_writer_pretty(w, &json)?))?;
    Ok(table)
}

/// Puts the frames' meshes into one folder, as programs that open numbered files want them: as links to the files in
/// the frames' folders where the file system has links.
fn meshes(folder: &SequenceFolder, frames: &[&Shot]) -> Result<()> {
    let dir = folder.root().join(MESHES);
    create_dir(&dir)?;
    for (i, frame) in frames.iter().enumerate() {
        let (from, to) = (folder.frame(frame).join("mesh.ply"), dir.join(format!("{i:04}.ply")));
        link(&from, &to).with_context(|| format!("{}: cannot be written", shown(&to)))?;
    }
    Ok(())
}

/// Writes the moving surface. A binary glTF holds 4 GiB at most; vertices of longer sequences are merged until it fits.
fn animation(folder: &SequenceFolder, frames: &[&Shot], table: &SequenceTable, fps: f64) -> Result<()> {
    let bytes = 28.0 * table.numbers("/mesh/vertices").sum::<f64>() + 12.0 * table.numbers("/mesh/faces").sum::<f64>();
    let cells = (bytes / MAX_BYTES).sqrt();
    let mut out = AnimatedGlb::new(fps);
    for frame in frames {
        let path = folder.frame(frame).join("mesh.ply");
        let mesh = Mesh::read(&path)?;
        out.push(&if cells > 1.0 { merge_vertices(&mesh, cells) } else { mesh })?;
    }
    Ok(out.write(&folder.root().join(ANIMATION))?)
}

/// Writes the moving picture: the surface as clay in the colors of its depth, one scale for all frames.
fn preview(folder: &SequenceFolder, frames: &[&Shot], table: &SequenceTable, fps: f64) -> Result<()> {
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

/// Makes a link, or a copy where the file system has no links. Another task may be doing the same: the second finds it
/// done.
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
