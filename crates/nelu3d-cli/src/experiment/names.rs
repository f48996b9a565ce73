//! Names of files, and arguments of commands.

/// Turns a text into a part of a file name.
pub(super) fn slug(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            c if c.is_ascii_alphanumeric() || c == '.' => out.push(c.to_ascii_lowercase()),
            _ if out.ends_with('-') || out.is_empty() => {}
            _ => out.push('-'),
        }
    }
    out.trim_end_matches('-').to_owned()
}

/// Returns words as arguments.
pub(super) fn words(&self, text: &str) -> Vec<String> {
        let mut text = text.to_owned();
        for (name, value) in self.values() {
            text = substitute_text(&text, name, &value);
        }
        text.split_whitespace().map(str::to_owned).collect()
    }
}

fn one(
    place: &Placeholders<'_>,
    case: &Case,
    method: &Method,
    root: &Path,
    cell: &mut Cell,
    runner: &mut Runner<'_>,
) -> Result<Result<Value, String>> {
    // The rig.
    let source = &place.experiment.rigs[&case.rig];
    let (rig_dir, rig_key) = match rig(place, &case.rig, source, root, cell, runner)? {
        Ok(rig) => rig,
        Err(reason) => return Ok(Err(reason)),
    };
    let rig = Rig::open(&rig_dir)?;
    let wanted = method.set.as_deref().or(case.set.as_deref());
    let set = rig.pattern_set(wanted)?.name.clone();
    let mut run = place.words(&method.run);
    let command = run.remove(0);
    // A sequence is judged as a whole and shown by the frame in its middle.
    let middle = match command.as_str() {
        "sequence" => {
            let frames = rig.sequence(&case.scene)?;
            Some(frames[frames.len() / 2].clone())
        }
        _ => None,
    };
    cell.scene = match &middle {
        Some(frame) => frame.dir.clone(),
        None => rig.scene(&case.scene)?.dir,
    };

    // Its color field. Decoders use it too, for the volume they look in.
    let extra = place.words(&method.calibrate);
    let field = match extra.is_empty() {
        true => rig_dir.join("fields").join(format!("{set}.safetensors")),
        false => rig_dir.join("fields").join(format!("{set}-{}.safetensors", slug(&extra.join("-")))),
    };
    let mut arguments = words(&["calibrate", &shown(&rig_dir), "--set", &set, "-o", &shown(&field)]);
    arguments.extend(extra);
    arguments.extend(runner.device());
    let calibrate = Step {
        what: format!("calibrate {} {set}", rig.name),
        arguments,
        output: Some(field.clone()),
        inputs: vec![rig_key.clone()],
    };
    let calibrated = match take(&calibrate, cell, runner)? {
        Ok(outcome) => outcome,
        Err(reason) => return Ok(Err(format!("calibrate: {reason}"))),
    };

    // The method.
    let mut arguments = words(&[&command, &shown(&rig_dir), &case.scene, "--set", &set]);
    if command == "reconstruct" || command == "sequence" {
        arguments.extend(words(&["--field", &shown(&field)]));
        arguments.extend(runner.device());
    }
    arguments.extend(run);
    let truth = cell.scene.join("truth");
    match truth.exists() {
        true if middle.is_some() => arguments.push("--truth".into()),
        true => arguments.extend(words(&["--truth", &shown(&truth)])),
        false => {}
    }
    arguments.extend(words(&["-o", &shown(&cell.folder)]));
    let result = Step {
        what: format!("{}: {}", case.label, method.label),
        arguments,
        output: Some(cell.folder.clone()),
        inputs: vec![calibrate.key()],
    };
    let made = match take(&result, cell, runner)? {
        Ok(outcome) => outcome,
        Err(reason) => return Ok(Err(reason)),
    };
    if let Some(frame) = &middle {
        cell.folder = cell.folder.join(&frame.name);
    }

    let mut document = json!({
        "result": made.answer[if middle.is_some() { "mean" } else { "summary" }],
        "calibrate": calibrated.answer,
        "step": { "wall_secs": made.wall_secs, "calibrate_wall_secs": calibrated.wall_secs },
    });
    if place.experiment.columns.iter().any(|c| c.value.starts_with("cad.")) {
        let arguments =
            words(&["evaluate", &shown(&cell.folder), "--cad", &shown(&truth.join("mesh.ply")), "--no-align"]);
        let judge = Step {
            what: format!("{}: {} against the CAD model", case.label, method.label),
            arguments,
            output: None,
            inputs: vec![result.key()],
        };
        if let Ok(outcome) = take(&judge, cell, runner)? {
            document["cad"] = outcome.answer;
        }
    }
    Ok(Ok(document))
}

/// Runs a step for a cell.
fn take(step: &Step, cell: &mut Cell, runner: &mut Runner<'_>) -> Result<Result<Outcome, String>> {
    cell.commands.push(format!("nelu3d {}", step.arguments.join(" ")));
    runner.run(step)
}

/// The folder of a rig and what identifies its content.
fn rig(
    place: &Placeholders<'_>,
    name: &str,
    source: &RigSource,
    root: &Path,
    cell: &mut Cell,
    runner: &mut Runner<'_>,
) -> Result<Result<(PathBuf, String), String>> {
    if let Some(folder) = &source.folder {
        let dir = root.join("rigs").join(slug(name));
        link(folder, &dir)?;
        return Ok(Ok((dir, shown(folder))));
    }
    let spec = match (&source.preset, &source.spec) {
        (Some(preset), _) => Spec::preset(preset)
            .with_context(|| format!("rig `{name}`: there is no preset `{preset}`; see `nelu3d simulate --help`"))?,
        (None, Some(file)) => Spec::read(file)?,
        (None, None) => unreachable!("checked when it was read"),
    };
    let mut table: Table = toml::from_str(&spec.to_toml()).context("a spec is TOML")?;
    merge(&mut table, &place.table(&source.set));
    table.insert("seed".into(), toml::Value::Integer(place.seed as i64));
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
    let step = Step {
        what: format!("simulate {name}, seed {}", place.seed),
        arguments: words(&["simulate", &shown(&file), "-o", &shown(&dir)]),
        output: Some(dir.clone()),
        inputs: vec![text],
    };
    Ok(take(&step, cell, runner)?.map(|_| (dir, step.key())).map_err(|reason| format!("simulate: {reason}")))
}

/// The same view on an image of another size.
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

/// A folder of links to everything in a rig, so that fields can be put beside it.
fn link(rig: &Path, dir: &Path) -> Result<()> {
    let rig =
        rig.canonicalize().with_context(|| format!("{}: is no folder; this experiment needs that rig", shown(rig)))?;
    create_dir(dir)?;
    for entry in std::fs::read_dir(&rig).with_context(|| format!("{}: cannot be read", shown(&rig)))? {
        let entry = entry?;
        let to = dir.join(entry.file_name());
        let ours = matches!(entry.file_name().to_str(), Some("fields" | "results"));
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

/// How the results of a scene differ from that of one method.
fn compare_with(label: &str, experiment: &Experiment, cells: &mut [Cell]) -> Result<()> {
    let reference = cells.iter().find(|c| experiment.methods[c.method].label == label && c.document.is_ok());
    let Some(reference) = reference.map(|c| SavedResult::read(&c.folder)).transpose()? else { return Ok(()) };
    for cell in cells {
        let folder = cell.folder.clone();
        if let Ok(document) = &mut cell.document {
            let ours = SavedResult::read(&folder)?;
            if ours.depth.len() == reference.depth.len() {
                document["against"] = json!(compare(&ours.depth, &reference.depth));
            }
        }
    }
    Ok(())
}

/// A text as a part of a file name.
fn slug(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            c if c.is_ascii_alphanumeric() || c == '.' => out.push(c.to_ascii_lowercase()),
            _ if out.ends_with('-') || out.is_empty() => {}
            _ => out.push('-'),
        }
    }
    out.trim_end_matches('-').to_owned()
}

/// Returns words as arguments.
pub(super) fn words(list: &[&str]) -> Vec<String> {
    list.iter().map(|s| (*s).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain() {
        assert_eq!(slug("NeLU3D (fast), α = 0.1"), "nelu3d-fast-0.1");
    }
}
