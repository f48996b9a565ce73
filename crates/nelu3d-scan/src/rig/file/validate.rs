//! Checking the values of rig.toml.

use std::collections::HashSet;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};

use super::board::board;
use super::problems::Problems;
use super::schema::{CameraToml, FORMAT, ImagesToml, PatternSetToml, PoseToml, RigToml};
use crate::camera::{Camera, Projector};
use crate::image::{Channels, Response};
use crate::input::{MAX_TEXT, read_file};
use crate::rig::{KnownPose, PatternSet, RIG_FILE, Rig, RigError};

/// Returns the rig that rig.toml describes, and everything that is wrong with its values. With problems the rig is only
/// good for looking for more of them.
pub(in crate::rig) fn from_toml(
    root: &Path,
    toml: RigToml,
    camera: Camera,
    projector: Option<Projector>,
) -> (Rig, Vec<RigError>) {
    let mut problems = Problems { path: root.join(RIG_FILE), found: Vec::new() };
    problems.expect(toml.format == FORMAT, "format", format!("is {}", toml.format), "it must be 1");
    let channels = check_sensor(&toml.camera, &mut problems);
    let intrinsics = !toml.camera.intrinsics.trim().is_empty();
    problems.expect(intrinsics, "camera.intrinsics", "is empty", "give the name of a file");
    check_flash(&toml.images, &mut problems);
    check_pattern_sets(&toml.pattern_sets, &toml.images, &mut problems);
    let response = toml.camera.response.as_deref().and_then(|name| response(root, name, &mut problems));
    let board = toml.board.and_then(|b| board(b, &mut problems));
    check_poses(&toml.poses, &mut problems);
    let known_pose = |p: PoseToml| KnownPose {
        cam_from_board: Isometry3::new(Vector3::from(p.translation), Vector3::from(p.rotation)),
        position: p.position,
    };
    let pattern_set = |s: PatternSetToml| PatternSet { name: s.name, images: s.images, inverse: s.inverse };
    let rig = Rig {
        root: root.to_path_buf(),
        name: toml.name,
        camera,
        camera_file: toml.camera.intrinsics,
        channels: channels.unwrap_or(Channels::Mono),
        response,
        black_level: toml.camera.black_level,
        saturation: toml.camera.saturation,
        white: toml.images.white,
        black: toml.images.black,
        pattern_sets: toml.pattern_sets.into_iter().map(pattern_set).collect(),
        board,
        poses: toml.poses.into_iter().map(known_pose).collect(),
        projector,
        memory: None,
    };
    (rig, problems.found)
}

/// Returns how codes follow light; `name` is a word or a file of the rig.
fn response(root: &Path, name: &str, problems: &mut Problems) -> Option<Response> {
    let found = match name {
        "linear" => Ok(Response::Linear),
        "srgb" => Ok(Response::Srgb),
        file => read_file(&root.join(file), MAX_TEXT)
            .map_err(|e| format!("cannot be read ({e})"))
            .and_then(|bytes| Response::from_json(file, &bytes)),
    };
    let remedy = "give \"linear\", \"srgb\", or a file with {\"code\": […], \"light\": […]}, rising from 0 to 1";
    match found {
        Ok(response) => Some(response),
        Err(e) => {
            problems.expect(false, "camera.response", format!("is \"{name}\": {e}"), remedy);
            None
        }
    }
}

/// Checks channels and levels; returns the channels, if they are known.
fn check_sensor(camera: &CameraToml, problems: &mut Problems) -> Option<Channels> {
    let channels = Channels::from_name(&camera.channels);
    problems.expect(
        channels.is_some(),
        "camera.channels",
        format!("is \"{}\"", camera.channels),
        &format!("it must be one of: {}", Channels::ALL.map(Channels::name).join(", ")),
    );
    let (black, saturation) = (camera.black_level, camera.saturation);
    problems.expect(
        black.is_finite() && saturation.is_finite() && saturation > black,
        "camera.saturation",
        format!("is {saturation:?}, with camera.black_level = {black:?}"),
        "saturation must lie above black_level",
    );
    channels
}

/// Checks the names of the flash and of the ambient image.
fn check_flash(images: &ImagesToml, problems: &mut Problems) {
    let good = problems.expect_image("images.white", &images.white);
    if problems.expect_image("images.black", &images.black) && good {
        let problem = "is the same image as images.white";
        problems.expect(images.white != images.black, "images.black", problem, "name the image with the light off");
    }
}

fn check_pattern_sets(sets: &[PatternSetToml], flash: &ImagesToml, problems: &mut Problems) {
    let mut names = HashSet::new();
    for set in sets {
        let key = |field: &str| format!("pattern_sets `{}`: {field}", set.name);
        problems.expect_name("pattern_sets.name", &set.name);
        let unique = names.insert(set.name.clone());
        problems.expect(unique, &key("name"), "is used twice", "give every pattern set its own name");
        problems.expect(!set.images.is_empty(), &key("images"), "is empty", "list at least one pattern image");
        for (field, names) in [("images", &set.images), ("inverse", &set.inverse)] {
            let mut seen = HashSet::new();
            for name in names {
                if !problems.expect_image(&key(field), name) {
                    continue;
                }
                let problem = format!("lists \"{name}\", which is the light at its maximum or off, not a pattern");
                let remedy = "list images of patterns only, and name white and black in [images]";
                problems.expect(*name != flash.white && *name != flash.black, &key(field), problem, remedy);
                let remedy = "list each image once: the same one again tells nothing more";
                problems.expect(seen.insert(name), &key(field), format!("lists \"{name}\" twice"), remedy);
            }
        }
        if let Some((name, _)) = set.images.iter().zip(&set.inverse).find(|(image, inverse)| image == inverse) {
            let problem = format!("lists \"{name}\" as its own inverse");
            problems.expect(false, &key("inverse"), problem, "name the image of the inverted pattern");
        }
        problems.expect(
            set.inverse.is_empty() || set.inverse.len() == set.images.len(),
            &key("inverse"),
            format!("lists {} files for {} images", set.inverse.len(), set.images.len()),
            "list one inverse per image, in the same order, or none",
        );
    }
}

fn check_poses(poses: &[PoseToml], problems: &mut Problems) {
    let mut positions = HashSet::new();
    for pose in poses {
        let key = format!("poses `{}`", pose.position);
        problems.expect_name("poses.position", &pose.position);
        problems.expect(positions.insert(&pose.position), &key, "is given twice", "give one pose per position");
        let finite = pose.rotation.iter().chain(&pose.translation).all(|v| v.is_finite());
        problems.expect(finite, &key, "holds a value that is not finite", "give finite numbers, or leave the pose out");
    }
}
