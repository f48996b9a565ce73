//! The rigs of an experiment: simulated, or folders that exist.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use nelu3d_scan::output::{create_dir, write_atomic};
use nelu3d_scan::rig::PROJECTOR_FILE;
use nelu3d_sim::Spec;
use toml::Table;

use super::cell::ExperimentCell;
use super::file::{RigSource, merge};
use super::names::{slug, words};
use super::placeholders::Placeholders;
use super::step::{CommandStep, StepRunner, hex};
use crate::paths::shown;

/// Folders of a rig that experiments write themselves.
const OURS: [&str; 2] = ["fields", "results"];

/// Makes the folder of a rig, and returns it with what identifies its content.
pub(super) fn prepare_rig(
    placeholders: &Placeholders<'_>,
    name: &str,
    source: &RigSource,
    root: &Path,
    cell: &mut ExperimentCell,
    runner: &mut StepRunner<'_>,
) -> Result<Result<(PathBuf, String), String>> {
    if let Some(folder) = &source.folder {
        let dir = root.join("rigs").join(slug(name));
        link(folder, &dir, &OURS)?;
        return Ok(Ok((dir, shown(folder))));
    }
    let spec = match (&source.preset, &source.spec) {
        (Some(preset), _) => Spec::preset(preset)
            .with_context(|| format!("rig `{name}`: there is no preset `{preset}`; see `nelu3d simulate --help`"))?,
        (None, Some(file)) => Spec::read(file)?,
        (None, None) => unreachable!("checked when it was read"),
    };
    let mut table: Table = toml::from_str(&spec.to_toml()).context("a spec is TOML")?;
    merge(&mut table, &placeholders.table(&source.set));
    table.insert("seed".into(), toml::Value::Integer(placeholders.seed as i64));
    if source.scale != 1.0 {
        scale_camera(&mut table, source.scale);
    }
    let text = toml::to_string(&table)?;
    let key = hex(text.as_bytes())[..12].to_owned();
    let dir = root.join("rigs").join(format!("{}-{key}", slug(name)));
    let file = root.join("rigs").join(format!("{}-{key}.toml", slug(name)));
    create_dir(&root.join("rigs"))?;
    write_atomic(&file, |w| w.write_all(text.as_bytes()))?;
    // Wrong values should be known to be the experiment's.
    Spec::read(&file).with_context(|| format!("rig `{name}`"))?;
    let step = CommandStep {
        what: format!("simulate {name}, seed {}", placeholders.seed),
        arguments: words(&["simulate", &shown(&file), "-o", &shown(&dir)]),
        output: Some(dir.clone()),
        inputs: vec![text],
    };
    Ok(cell.run(&step, runner)?.map(|_| (dir, step.key())).map_err(|reason| format!("simulate: {reason}")))
}

/// Scales the camera of a spec: the same view on an image of another size.
fn scale_camera(spec: &mut Table, scale: f64) {
    let Some(toml::Value::Table(camera)) = spec.get_mut("camera") else { return };
    for (key, shift) in [("fx", 0.0), ("fy", 0.0), ("cx", 0.5), ("cy", 0.5)] {
        if let Some(v) = camera.get(key).and_then(toml::Value::as_float) {
            camera.insert(key.into(), toml::Value::Float((v + shift) * scale - shift));
        }
    }
    for key in ["width", "height"] {
        if let Some(v) = camera.get(key).and_then(toml::Value::as_integer) {
            // Even, for color filter mosaics.
            let side = 2 * (v as f64 * scale / 2.0).round() as i64;
            camera.insert(key.into(), toml::Value::Integer(side));
        }
    }
}

/// Makes a folder like the rig `rig_dir` whose projector is calibrated from its own sweep, with the options of `nelu3d
/// projector`; returns it with what identifies its content.
pub(super) fn with_calibrated_projector(
    (rig_dir, rig_key): (&Path, &str),
    options: &[String],
    cell: &mut ExperimentCell,
    runner: &mut StepRunner<'_>,
) -> Result<Result<(PathBuf, String), String>> {
    let name = rig_dir.file_name().unwrap_or_default().to_string_lossy();
    let dir = rig_dir.with_file_name(slug(&format!("{name}-projector-{}", options.join("-"))));
    link(rig_dir, &dir, &[OURS[0], OURS[1], PROJECTOR_FILE])?;
    let file = dir.join(PROJECTOR_FILE);
    let mut arguments = words(&["projector", &shown(&dir), "-o", &shown(&file), "--force"]);
    arguments.extend_from_slice(options);
    let what = format!("projector {name}");
    let step = CommandStep { what, arguments, output: Some(file), inputs: vec![rig_key.to_owned()] };
    Ok(cell.run(&step, runner)?.map(|_| (dir, step.key())).map_err(|reason| format!("projector: {reason}")))
}

/// Fills a folder with links to everything in a rig except `own`, so that fields can be put beside it.
fn link(rig: &Path, dir: &Path, own: &[&str]) -> Result<()> {
    let rig =
        rig.canonicalize().with_context(|| format!("{}: is no folder; this experiment needs that rig", shown(rig)))?;
    create_dir(dir)?;
    for entry in std::fs::read_dir(&rig).with_context(|| format!("{}: cannot be read", shown(&rig)))? {
        let entry = entry?;
        let to = dir.join(entry.file_name());
        let ours = entry.file_name().to_str().is_some_and(|name| own.contains(&name));
        if !ours && !to.exists() {
            #[cfg(unix)]
            std::os::unix::fs::symlink(entry.path(), &to)
                .with_context(|| format!("{}: cannot be linked", shown(&to)))?;
            #[cfg(not(unix))]
            anyhow::bail!("{}: rigs that exist can be used on Unix only", shown(&rig));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scaled_camera_sees_the_same() {
        let spec = Spec::preset("demo").unwrap();
        let mut table: Table = toml::from_str(&spec.to_toml()).unwrap();
        scale_camera(&mut table, 0.5);
        let half: Spec = table.try_into().unwrap();
        assert_eq!((half.camera.width, half.camera.height), (spec.camera.width / 2, spec.camera.height / 2));
        // The left border of the image, x = −0.5, is in the same direction.
        let border = |s: &Spec| (-0.5 - s.camera.cx) / s.camera.fx;
        assert!((border(&half) - border(&spec)).abs() < 1e-12);
    }
}
