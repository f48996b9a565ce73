//! Everything that is wrong with a rig folder, in one go.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::capture::What;
use super::file::{RigToml, from_toml, read_toml};
use super::{PROJECTOR_FILE, RIG_FILE, Rig, RigError, Shot};
use crate::camera::{Camera, CameraFileError, read_camera, read_projector};
use crate::image::{Channels, Depth, Image, ImageFileError, decode};
use crate::{Mesh, npy};

/// How bad a [`Finding`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Something will not work.
    Error,
    /// It works, but probably not as meant.
    Warning,
}

/// One thing that is wrong with a rig folder.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// The file or folder concerned.
    #[serde(serialize_with = "crate::path_text::serialize")]
    pub file: PathBuf,
    /// What is wrong.
    pub problem: String,
    /// What to do about it.
    pub remedy: String,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        write!(f, "{severity}: {}: {}", self.file.display(), self.problem)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "; {}", self.remedy) }
    }
}

/// Smallest white − black that counts as light, as a fraction of full scale.
const DARK: f32 = 0.02;
/// Fraction of pixels that counts as nearly all.
const NEARLY_ALL: f64 = 0.99;
/// Smallest number of usable board positions.
const MIN_POSITIONS: usize = 3;

/// What kind of folder a shot is.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Position,
    Scene,
    Frame,
}

impl Rig {
    /// Lists all that is wrong with this rig's folder, which is read anew: see [`check`].
    pub fn check(&self) -> Vec<Finding> {
        check(&self.root)
    }
}

/// Looks at every file of the rig at `path` (the folder or its rig.toml) and lists all that is wrong: rig.toml, the
/// camera files, missing, unreadable or odd images, too dark or clipped flashes, too few positions, bad ground truth.
/// Works on broken rigs too. An empty list means that nothing was found.
///
/// Shots are checked in parallel, with about three images per thread in memory. The list is in a fixed order.
pub fn check(path: &Path) -> Vec<Finding> {
    let (root, toml) = match read_toml(path) {
        Ok(read) => read,
        Err(e) => return vec![rig_finding(path, &e)],
    };
    let mut findings = Vec::new();
    let camera = check_cameras(&root, &toml, &mut findings);
    let has_target = toml.board.is_some() || !toml.poses.is_empty();
    let sensor_known = Channels::from_name(&toml.camera.channels).is_some();
    // Without intrinsics the size of the images is unknown; the rest of rig.toml is checked all the same.
    let any = camera.clone().unwrap_or_else(|| Camera::pinhole(1, 1, 1.0, 1.0, 0.0, 0.0));
    let (rig, problems) = from_toml(&root, toml, any, None);
    findings.extend(problems.iter().map(|e| rig_finding(&root.join(RIG_FILE), e)));
    if rig.pattern_sets.is_empty() {
        let remedy = "add a [[pattern_sets]] with name and images";
        findings.push(error(root.join(RIG_FILE), "has no pattern set", remedy));
    }

    let shots = list_shots(&rig, has_target, &mut findings);
    let sensor_known = sensor_known && rig.saturation > rig.black_level;
    let checker = Checker { rig: &rig, size: camera.map(|c| (c.width, c.height)), sensor_known };
    let (mut per_shot, counts): (Vec<Vec<Finding>>, Vec<Vec<Count>>) =
        shots.par_iter().map(|(role, shot)| checker.shot(*role, shot)).unzip();
    compare_counts(&mut per_shot, &counts);
    let broken_positions = shots
        .iter()
        .zip(&per_shot)
        .filter(|((role, _), found)| *role == Role::Position && found.iter().any(|f| f.severity == Severity::Error))
        .count();
    let positions = shots.iter().filter(|(role, _)| *role == Role::Position).count();
    if positions >= MIN_POSITIONS && positions - broken_positions < MIN_POSITIONS {
        let problem = format!("only {} of {positions} positions are without errors", positions - broken_positions);
        findings.push(error(root.join("calibration"), &problem, "calibration needs 3 usable positions or more"));
    }
    findings.extend(per_shot.into_iter().flatten());
    findings
}

/// Checks the intrinsics and the projector; the camera, if it is good.
fn check_cameras(root: &Path, toml: &RigToml, findings: &mut Vec<Finding>) -> Option<Camera> {
    let file = root.join(PROJECTOR_FILE);
    if file.exists()
        && let Err(e) = read_projector(&file)
    {
        findings.push(camera_finding(&e));
    }
    read_camera(&root.join(&toml.camera.intrinsics)).map_err(|e| findings.push(camera_finding(&e))).ok()
}

/// Lists all folders with images, and notes what is wrong with their number and names.
fn list_shots(rig: &Rig, has_target: bool, findings: &mut Vec<Finding>) -> Vec<(Role, Shot)> {
    let mut shots = Vec::new();
    let mut keep = |role, found: Result<Vec<Shot>, RigError>, findings: &mut Vec<Finding>| match found {
        Ok(found) => {
            shots.extend(found.into_iter().map(|s| (role, s)));
            true
        }
        Err(e) => {
            findings.push(rig_finding(&rig.root, &e));
            false
        }
    };

    let calibration = rig.root.join("calibration");
    if calibration.is_dir() {
        keep(Role::Position, rig.positions(), findings);
    } else if rig.projector.is_none() && !rig.root.join(PROJECTOR_FILE).exists() {
        let remedy = "capture a sweep, or add projector.json to compute the color field from the patterns";
        findings.push(warning(calibration, "the rig has neither a calibration sweep nor a projector", remedy));
    }
    keep(Role::Scene, rig.scenes(), findings);
    match rig.sequences() {
        Ok(all) => {
            for sequence in all {
                keep(Role::Frame, rig.frames(sequence), findings);
            }
        }
        Err(e) => findings.push(rig_finding(&rig.root, &e)),
    }

    let positions: Vec<&str> =
        shots.iter().filter(|(role, _)| *role == Role::Position).map(|(_, s)| s.name.as_str()).collect();
    if !positions.is_empty() {
        if positions.len() < MIN_POSITIONS {
            let problem = format!("has {} board positions", positions.len());
            findings.push(error(rig.root.join("calibration"), &problem, "calibration needs 3 or more: capture more"));
        }
        if !has_target {
            let remedy = "describe the target of the sweep in [board]";
            findings.push(error(rig.root.join(RIG_FILE), "has a calibration sweep but no [board]", remedy));
        }
    }
    for pose in &rig.poses {
        if !positions.contains(&pose.position.as_str()) {
            let problem = format!("`poses` names the position `{}`, which has no folder", pose.position);
            findings.push(warning(rig.root.join(RIG_FILE), &problem, "correct the name, or remove the pose"));
        }
    }
    shots
}

/// Checks shots, with what it needs to know of the rig.
struct Checker<'a> {
    rig: &'a Rig,
    /// Size of the images, if the intrinsics are good.
    size: Option<(usize, usize)>,
    /// Whether channels and levels are good.
    sensor_known: bool,
}

/// The properties that all images of a shot share.
struct Agreed {
    file: PathBuf,
    depth: Depth,
    size: (usize, usize),
    channels: usize,
}

/// A pattern of a shot, and the number of its channels.
type Count = (PathBuf, usize);

/// Adds a finding for each pattern that has another number of channels than in the shot where they are first.
fn compare_counts(findings: &mut [Vec<Finding>], counts: &[Vec<Count>]) {
    let mut first: HashMap<&OsStr, &Count> = HashMap::new();
    for (findings, counts) in findings.iter_mut().zip(counts) {
        for count in counts {
            let name = count.0.file_name().expect("a pattern's file");
            let (other, expected) = *first.entry(name).or_insert(count);
            if count.1 != *expected {
                let problem = format!("has {} channels, but {} has {expected}", count.1, other.display());
                findings.push(error(count.0.clone(), &problem, "take this pattern the same way everywhere"));
            }
        }
    }
}

impl Checker<'_> {
    /// Checks a shot: returns what is wrong with it, and how many channels its patterns have.
    fn shot(&self, role: Role, shot: &Shot) -> (Vec<Finding>, Vec<Count>) {
        let mut findings = Vec::new();
        let mut counts = Vec::new();
        let mut agreed = None;
        let rig = self.rig;
        let white = self.image(&shot.dir.join(&rig.white), What::Flash, &mut agreed, &mut findings);
        let black_file = shot.dir.join(&rig.black);
        let black = if role == Role::Position || black_file.exists() {
            self.image(&black_file, What::Flash, &mut agreed, &mut findings)
        } else {
            None
        };
        if let Some(white) = &white {
            check_flash(&shot.dir.join(&rig.white), white, black.as_ref(), &mut findings);
        }
        drop((white, black));

        // Sets may share images: each file is looked at once.
        let mut names: Vec<&String> = rig.pattern_sets.iter().flat_map(|s| &s.images).collect();
        let inverse = rig.pattern_sets.iter().flat_map(|s| &s.inverse);
        // Only decoders need the inverses, so any folder may lack them; those that are there must be good.
        names.extend(inverse.filter(|n| shot.dir.join(n).exists()));
        names.sort();
        names.dedup();
        for name in names {
            if name.is_empty() || *name == rig.white || *name == rig.black {
                continue;
            }
            let file = shot.dir.join(name);
            if let Some(image) = self.image(&file, What::Pattern, &mut agreed, &mut findings) {
                counts.push((file.clone(), image.channels));
                if fraction(&image, |v| v >= 1.0) > NEARLY_ALL {
                    findings.push(error(file, "is clipped nearly everywhere", CLIPPED_REMEDY));
                }
            }
        }
        self.check_ground_truth(shot, &mut findings);
        (findings, counts)
    }

    /// Reads an image and adds a finding for all that is wrong with it. Returns `None` if it cannot be used.
    fn image(
        &self,
        file: &Path,
        what: What,
        agreed: &mut Option<Agreed>,
        findings: &mut Vec<Finding>,
    ) -> Option<Image> {
        let raw = match decode(file, self.size) {
            Ok(raw) => raw,
            Err(e) => {
                findings.push(image_finding(&e));
                return None;
            }
        };
        let (depth, size, channels) = (raw.depth(), (raw.width, raw.height), raw.channels);
        let stored = self.rig.stored_as(&raw, what);
        match agreed {
            None => *agreed = Some(Agreed { file: file.to_path_buf(), depth, size, channels }),
            Some(first) => {
                let first_name = first.file.file_name().unwrap_or_default().to_string_lossy();
                let mut differ = |problem: String| {
                    findings.push(error(file.to_path_buf(), &problem, "capture one folder's images with one setting"));
                };
                if depth != first.depth {
                    differ(format!("is {depth}, but {first_name} is {}", first.depth));
                }
                if size != first.size {
                    let ((a, b), (c, d)) = (size, first.size);
                    differ(format!("is {a}x{b} pixels, but {first_name} is {c}x{d}"));
                }
                if channels != first.channels && stored == self.rig.channels {
                    differ(format!("has {channels} channels, but {first_name} has {}", first.channels));
                }
            }
        }
        if !self.sensor_known {
            return None;
        }
        let rig = self.rig;
        match rig.check_response(file).and_then(|()| rig.linear(&raw, file, stored)) {
            Ok(image) => Some(image),
            Err(e) => {
                findings.push(image_finding(&e));
                None
            }
        }
    }

    /// Checks the ground truth in `truth/`, if there is one.
    fn check_ground_truth(&self, shot: &Shot, findings: &mut Vec<Finding>) {
        let dir = shot.dir.join("truth");
        let depth_file = dir.join("depth.npy");
        let remedy = "write it again, for the camera's image size";
        if depth_file.exists() {
            match npy::read(&depth_file) {
                Ok(array) => {
                    if let Some((w, h)) = self.size.filter(|&(w, h)| array.shape != [h, w]) {
                        let problem = format!("has the shape {:?}, not (height, width) = [{h}, {w}]", array.shape);
                        findings.push(error(depth_file, &problem, remedy));
                    } else if array.data.iter().any(|&z| z <= 0.0 || z.is_infinite()) {
                        let problem = "holds depths that are not positive";
                        findings.push(error(depth_file, problem, "depth is camera z in mm, NaN where there is none"));
                    }
                }
                Err(e) => findings.push(finding(Severity::Error, &depth_file, &e.to_string())),
            }
        }
        let mask_file = dir.join("mask.png");
        if mask_file.exists() {
            match decode(&mask_file, self.size) {
                Ok(raw) if raw.channels != 1 => {
                    findings.push(error(mask_file, "has three channels", "save it with one: 255 inside, 0 outside"));
                }
                Ok(_) => {}
                Err(e) => findings.push(image_finding(&e)),
            }
        }
        let mesh_file = dir.join("mesh.ply");
        if mesh_file.exists()
            && let Err(e) = Mesh::read(&mesh_file)
        {
            findings.push(finding(Severity::Error, &mesh_file, &e.to_string()));
        }
    }
}

const CLIPPED_REMEDY: &str = "shorten the exposure, dim the light, or correct camera.saturation";

/// Checks that the flash is one: brighter than the ambient light, and not clipped.
fn check_flash(file: &Path, white: &Image, black: Option<&Image>, findings: &mut Vec<Finding>) {
    let clipped = fraction(white, |v| v >= 1.0);
    if clipped > NEARLY_ALL {
        findings.push(error(file.to_path_buf(), "is clipped nearly everywhere", CLIPPED_REMEDY));
        return;
    } else if clipped > 0.2 {
        let problem = format!("is clipped in {:.0} % of its pixels", 100.0 * clipped);
        findings.push(warning(file.to_path_buf(), &problem, CLIPPED_REMEDY));
    }
    let dark = match black {
        Some(black) => {
            let n = white.data.iter().zip(&black.data).filter(|(w, b)| *w - *b < DARK).count();
            n as f64 / white.data.len() as f64
        }
        None => fraction(white, |v| v < DARK),
    };
    if dark > NEARLY_ALL {
        let problem = "is not brighter than black by 2 % of full scale, nearly everywhere";
        let remedy = "switch the light on for it, lengthen the exposure, or correct camera.black_level and saturation";
        findings.push(error(file.to_path_buf(), problem, remedy));
    }
}

/// Returns the fraction of values with a property.
fn fraction(image: &Image, property: impl Fn(f32) -> bool) -> f64 {
    image.data.iter().filter(|&&v| property(v)).count() as f64 / image.data.len() as f64
}

fn error(file: PathBuf, problem: &str, remedy: &str) -> Finding {
    Finding { severity: Severity::Error, file, problem: problem.into(), remedy: remedy.into() }
}

fn warning(file: PathBuf, problem: &str, remedy: &str) -> Finding {
    Finding { severity: Severity::Warning, file, problem: problem.into(), remedy: remedy.into() }
}

/// Makes a finding from an error's message `FILE: PROBLEM; REMEDY`, which is how this crate words them all.
fn finding(severity: Severity, file: &Path, message: &str) -> Finding {
    let prefix = format!("{}: ", file.display());
    let message = message.strip_prefix(&prefix).unwrap_or(message);
    let (problem, remedy) = message.rsplit_once("; ").unwrap_or((message, ""));
    Finding { severity, file: file.to_path_buf(), problem: problem.into(), remedy: remedy.into() }
}

fn image_finding(e: &ImageFileError) -> Finding {
    finding(Severity::Error, e.path(), &e.to_string())
}

fn camera_finding(e: &CameraFileError) -> Finding {
    finding(Severity::Error, e.path(), &e.to_string())
}

fn rig_finding(fallback: &Path, e: &RigError) -> Finding {
    finding(Severity::Error, e.path().unwrap_or(fallback), &e.to_string())
}
