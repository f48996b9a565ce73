//! What consecutive frames are.

use std::collections::HashSet;
use std::path::Path;

use super::ImportError;
use crate::rig::{NAME_RULE, PatternSet, RIG_FILE, Rig, is_name};

/// The word for a frame to skip.
const SKIP: &str = "skip";

/// The file name of each frame of a group; `None` for one to skip.
pub(super) type Slots = Vec<Option<String>>;

/// Returns the order that `words` state, for a rig that exists; without words, the images of the set and then white.
pub(super) fn of_rig(words: Option<&[String]>, rig: &Rig, set: Option<&str>) -> Result<Slots, ImportError> {
    let Some(words) = words else {
        let set = rig.pattern_set(set)?;
        return Ok(set.images.iter().chain([&rig.white]).cloned().map(Some).collect());
    };
    if let Some(set) = set {
        rig.pattern_set(Some(set))?;
    }
    let mut known = vec![rig.white.clone(), rig.black.clone()];
    known.extend(rig.pattern_sets.iter().flat_map(|s| s.images.iter().chain(&s.inverse)).cloned());
    let find = |word: &str| match word {
        "white" => Some(rig.white.clone()),
        "black" => Some(rig.black.clone()),
        _ => known.iter().find(|name| *name == word || stem(name) == word).cloned(),
    };
    let path = rig.root.join(RIG_FILE);
    let slots = words
        .iter()
        .map(|word| match word.trim() {
            SKIP => Ok(None),
            word => find(word).map(Some).ok_or_else(|| {
                let mut names: Vec<&str> = known.iter().map(|n| stem(n)).collect();
                names.sort_unstable();
                names.dedup();
                let remedy = format!("--order takes {SKIP} and the rig's images: {}", names.join(", "));
                ImportError::unfit(&path, format!("has no image `{word}`"), remedy)
            }),
        })
        .collect::<Result<Slots, _>>()?;
    checked(slots, &path)
}

/// Returns the order that `words` state for a rig that is made now, whose images get this ending; and its pattern set.
pub(super) fn of_new(
    words: Option<&[String]>,
    root: &Path,
    ending: &str,
    set: Option<&str>,
) -> Result<(Slots, PatternSet), ImportError> {
    let path = root.join(RIG_FILE);
    let Some(words) = words else {
        return Err(ImportError::unfit(
            path,
            "does not exist yet, so nothing says what the frames are",
            "give --order, as --order pattern,white",
        ));
    };
    let set = set.unwrap_or("recorded");
    if !is_name(set) {
        return Err(ImportError::unfit(path, format!("would get the pattern set `{set}`"), NAME_RULE));
    }
    let mut slots = Slots::new();
    for word in words.iter().map(|w| w.trim()) {
        if word == SKIP {
            slots.push(None);
            continue;
        }
        if !is_name(word) {
            let problem = format!("--order names an image `{word}`, which is no file name");
            return Err(ImportError::unfit(path, problem, "use letters, digits, - and _"));
        }
        let has_ending = ["png", "tif", "tiff"].contains(&super::frames::ending(Path::new(word)).as_str());
        slots.push(Some(if has_ending { word.to_owned() } else { format!("{word}.{ending}") }));
    }
    let slots = checked(slots, &path)?;
    let images: Vec<String> =
        slots.iter().flatten().filter(|n| !["white", "black"].contains(&stem(n))).cloned().collect();
    if images.is_empty() {
        return Err(ImportError::unfit(
            path,
            "does not exist yet, and --order names no pattern that its pattern set could hold",
            "import a recording of patterns first, or write rig.toml",
        ));
    }
    Ok((slots, PatternSet { name: set.into(), images, inverse: Vec::new() }))
}

/// Fails for an order that names nothing, or an image twice.
fn checked(slots: Slots, path: &Path) -> Result<Slots, ImportError> {
    let mut seen = HashSet::new();
    for name in slots.iter().flatten() {
        if !seen.insert(name) {
            let problem = format!("--order names {name} twice");
            return Err(ImportError::unfit(path, problem, "leave one out with skip, or average groups with --mean"));
        }
    }
    if seen.is_empty() {
        return Err(ImportError::unfit(path, "--order names no image", "give it as --order pattern,white"));
    }
    Ok(slots)
}

/// Returns what each folder will lack for `rig`: one sentence each.
pub(super) fn missing(names: &[&String], rig: &Rig, is_position: bool) -> Vec<String> {
    let has = |name: &String| names.contains(&name);
    let mut notes = Vec::new();
    if !has(&rig.white) {
        notes.push(format!("there is no {} among the images, which every folder needs", rig.white));
    }
    if is_position && !has(&rig.black) {
        let remedy = "record the light off and give it with --black";
        notes.push(format!("there is no {} among the images, which board positions need; {remedy}", rig.black));
    }
    let lacking = |s: &PatternSet| s.images.iter().filter(|n| !has(n)).cloned().collect::<Vec<_>>();
    let sets: Vec<(&PatternSet, Vec<String>)> = rig.pattern_sets.iter().map(|s| (s, lacking(s))).collect();
    if !sets.iter().any(|(_, lacking)| lacking.is_empty()) {
        let each: Vec<String> =
            sets.iter().map(|(s, lacking)| format!("`{}` lacks {}", s.name, lacking.join(", "))).collect();
        notes.push(format!("no pattern set is complete: {}", each.join("; ")));
    }
    notes
}

fn stem(name: &str) -> &str {
    Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name)
}
