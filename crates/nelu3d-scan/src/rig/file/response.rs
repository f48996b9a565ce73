//! A measured response becomes part of a rig.

use std::path::Path;

use super::parse;
use crate::image::Response;
use crate::input::read_text;
use crate::output::write_atomic;
use crate::rig::{RIG_FILE, RigError};

/// Writes into the rig at `root` how its camera's codes follow light: a table into the file that it names, then
/// `response` in rig.toml, whose other lines stay as they are.
///
/// # Errors
///
/// rig.toml cannot be read, its table `[camera]` is not written in lines of its own, or a file cannot be written.
pub fn state_response(root: &Path, response: &Response) -> Result<(), RigError> {
    let file = root.join(RIG_FILE);
    let text = read_text(&file).map_err(|source| RigError::Io { path: file.clone(), source })?;
    let name = response.name();
    let changed = with_response(&text, name);
    let stated = parse(&file, changed.clone().into_bytes()).ok().and_then(|toml| toml.camera.response);
    if stated.as_deref() != Some(name) {
        return Err(RigError::Invalid {
            path: file,
            key: "camera.response".into(),
            problem: "cannot be put where it belongs".into(),
            remedy: format!("write response = {name:?} into the table [camera] by hand"),
        });
    }
    if matches!(response, Response::Table { .. }) {
        let json = response.to_json();
        write_atomic(&root.join(name), |w| w.write_all(json.as_bytes()))?;
    }
    // Last: what rig.toml names must be there.
    write_atomic(&file, |w| w.write_all(changed.as_bytes()))?;
    Ok(())
}

/// Returns the text of a rig.toml with this response.
fn with_response(text: &str, name: &str) -> String {
    let (line, mut inside, mut stated) = (format!("response = {name:?}"), false, false);
    let mut lines: Vec<String> = Vec::new();
    for old in text.lines() {
        let bare = old.trim();
        let is_key = inside && bare.strip_prefix("response").is_some_and(|rest| rest.trim_start().starts_with('='));
        if is_key && !stated {
            lines.push(line.clone());
            stated = true;
            continue;
        }
        if bare.starts_with('[') {
            inside = bare.split('#').next().is_some_and(|head| head.trim() == "[camera]");
        }
        lines.push(old.to_owned());
    }
    if !stated && let Some(i) = lines.iter().position(|l| l.split('#').next().is_some_and(|h| h.trim() == "[camera]")) {
        lines.insert(i + 1, line);
    }
    lines.join("\n") + "\n"
}
