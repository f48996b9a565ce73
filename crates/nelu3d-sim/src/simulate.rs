//! Writing a virtual scanner's captures as an ordinary rig folder.

use std::io;
use std::path::Path;

use nelu3d_scan::Image;
use nelu3d_scan::board::{Artwork, BoardError};
use nelu3d_scan::image::write_gray8;
use nelu3d_scan::mesh::MeshFileError;
use nelu3d_scan::output::{OutputDir, create_dir, write_atomic};
use nelu3d_scan::rig::{Rig, RigError};

use crate::capture::Capture;
use crate::light::Light;
use crate::render::Renderer;
use crate::scene::Scene;
use crate::sensor::Sensor;
use crate::sequence::shoot_sequence;
use crate::shown::{Shown, write_patterns};
use crate::spec::{FilmSpec, LightSpec, Spec, SpecError};
use crate::sweep::sweep_poses;
use crate::truth::Truth;

/// Why nothing was simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The spec makes no sense.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// The board cannot be printed.
    #[error("`board`: {0}")]
    Board(#[from] BoardError),
    /// The rig cannot be written.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// A file cannot be written; the message names it.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The true mesh cannot be written; the message names the file.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
}

/// What marks a folder as a simulated rig, which another simulation may replace: the spec it was made from.
const SPEC_FILE: &str = "simulation.toml";

/// Numbers of scenes' shots start here, so that their random numbers do not depend on the length of the sweep.
const FIRST_SCENE_SHOT: u64 = 1 << 32;

/// And those of sequences' frames here, each sequence's 2²⁰ after the one's before it.
const FIRST_SEQUENCE_SHOT: u64 = 1 << 33;

/// Captures everything a spec describes and writes the rig folder `out`: patterns, sweep, scenes and sequences with their
/// truth, and the spec itself as `simulation.toml` (with a film's picture beside it). The folder is written whole or not at all; an earlier simulation in its place is
/// replaced, anything else is not.
///
/// `progress` is told the stage, how many of its shots are done, and how many there are.
///
/// # Errors
///
/// A value of the spec makes no sense, the board cannot be printed, or a file cannot be written.
pub fn simulate(spec: &Spec, out: &Path, progress: &(dyn Fn(&str, usize, usize) + Sync)) -> Result<(), SimError> {
    spec.check()?;
    let board = spec.board.board();
    let artwork = Artwork::new(&board)?;
    let folder = OutputDir::create(out, SPEC_FILE)?;
    let root = folder.path();
    let saved = with_picture_in(spec, root)?;
    write_atomic(&root.join(SPEC_FILE), |w| w.write_all(saved.to_toml().as_bytes()))?;

    // What the light source can show.
    let shown = Shown::new(spec)?;
    let images: Vec<Image> = shown.images.iter().map(|p| p.image.clone()).collect();
    let light = Light::new(spec, &images);
    if let LightSpec::Projector(p) = &spec.light {
        write_patterns(&root.join("patterns"), &shown.images, [p.width, p.height])?;
    }

    let renderer = Renderer::new(spec);
    let poses = sweep_poses(spec);
    let rig = Rig {
        root: root.to_path_buf(),
        name: spec.name.clone(),
        camera: renderer.camera().clone(),
        camera_file: "camera.json".into(),
        channels: spec.camera.channels().expect("checked with the spec"),
        black_level: spec.camera.black_level,
        saturation: spec.camera.saturation(),
        white: "white.png".into(),
        black: "black.png".into(),
        pattern_sets: shown.sets.clone(),
        board: Some(board.clone()),
        poses: if spec.sweep.write_poses() { poses.clone() } else { Vec::new() },
        projector: light.projector(),
    };
    rig.save()?;

    // The sweep needs no inverse images: only decoders of scenes do.
    let camera = Capture { spec, renderer: &renderer, light: &light, sensor: Sensor::new(&spec.camera) };
    let frames = shown.frames(true, false);
    for (i, pose) in poses.iter().enumerate() {
        progress("sweep", i, poses.len());
        let scene = Scene::of_board(&board, artwork.clone(), spec.board_albedo, spec.print_dpi, &pose.cam_from_board);
        camera.shoot(&scene, &frames, i as u64, &root.join("calibration").join(&pose.position))?;
    }
    progress("sweep", poses.len(), poses.len());

    for (i, scene_spec) in spec.scenes.iter().enumerate() {
        progress("scenes", i, spec.scenes.len());
        let scene = Scene::new(&scene_spec.objects)?;
        let dir = root.join("scenes").join(&scene_spec.name);
        let frames = shown.frames(scene_spec.black, true);
        camera.shoot(&scene, &frames, FIRST_SCENE_SHOT + i as u64, &dir)?;
        write_truth(&dir.join("truth"), &rig, &Truth::new(renderer.camera(), &scene, &light))?;
    }
    progress("scenes", spec.scenes.len(), spec.scenes.len());

    for (i, sequence) in spec.sequences.iter().enumerate() {
        let patterns = shown.frames_of_set(sequence.pattern_set.as_deref());
        for frame in 0..sequence.frames {
            progress(&sequence.name, frame, sequence.frames);
            let shot = FIRST_SEQUENCE_SHOT + ((i as u64) << 20) + frame as u64;
            let dir = root.join("sequences").join(&sequence.name).join(frame_name(frame, sequence.frames));
            let truth = shoot_sequence(&camera, sequence, frame, &patterns, shot, &dir)?;
            write_truth(&dir.join("truth"), &rig, &truth)?;
        }
        progress(&sequence.name, sequence.frames, sequence.frames);
    }
    folder.commit()?;
    Ok(())
}

/// Frames are named by their number, with as many digits as the last needs, at least three.
fn frame_name(frame: usize, frames: usize) -> String {
    let digits = (frames - 1).to_string().len().max(3);
    format!("{frame:0digits$}")
}

/// The spec as it is saved: a film's picture is copied beside it, so that the rig can be made again from itself.
fn with_picture_in(spec: &Spec, root: &Path) -> Result<Spec, SimError> {
    let mut saved = spec.clone();
    if let LightSpec::Film(FilmSpec { image: Some(image), .. }) = &mut saved.light {
        let name = Path::new("film").with_extension(image.extension().unwrap_or_default());
        std::fs::copy(&*image, root.join(&name)).map_err(|e| SpecError::Io { path: image.clone(), source: e })?;
        *image = name;
    }
    Ok(saved)
}

fn write_truth(dir: &Path, rig: &Rig, truth: &Truth) -> Result<(), SimError> {
    create_dir(dir)?;
    let (w, h) = (rig.camera.width, rig.camera.height);
    nelu3d_scan::npy::write(&dir.join("depth.npy"), &[h, w], &truth.depth)?;
    let mask: Vec<u8> = truth.mask.iter().map(|m| if *m { 255 } else { 0 }).collect();
    write_gray8(&dir.join("mask.png"), w, h, &mask)?;
    truth.mesh.write(&dir.join("mesh.ply"))?;
    Ok(())
}
