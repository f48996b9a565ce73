//! Writing a virtual scanner's captures as an ordinary rig folder.

use std::path::Path;

use nelu3d_scan::Image;
use nelu3d_scan::board::Board;
use nelu3d_scan::image::write_gray8;
use nelu3d_scan::output::{OutputDir, create_dir, write_atomic};
use nelu3d_scan::rig::{KnownPose, Rig};

use crate::capture::VirtualCamera;
use crate::displayed::{DisplayedImages, write_patterns};
use crate::error::SimulationError;
use crate::ground_truth::GroundTruth;
use crate::light::LightSource;
use crate::render::Renderer;
use crate::scene::{PrintedBoard, VirtualScene};
use crate::sensor::Sensor;
use crate::sequence::capture_frame;
use crate::spec::{FilmSpec, LightSpec, Spec, SpecError};
use crate::staging::{light_motion, stage};
use crate::sweep::{hands_at, sweep_poses};

/// File that marks a folder as a simulated rig, which another simulation may replace: the spec it was made from.
const SPEC_FILE: &str = "simulation.toml";

/// Number of the first scene's shot, so that random numbers of scenes do not depend on the length of the sweep.
const FIRST_SCENE_SHOT: u64 = 1 << 32;

/// Number of the first sequence's first frame; each sequence's frames begin 2²⁰ after those of the one before.
const FIRST_SEQUENCE_SHOT: u64 = 1 << 33;

/// Is told the stage, how many of its shots are done, and how many there are.
type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

/// The caller's side of a simulation.
#[derive(Clone, Copy)]
struct Caller<'a> {
    progress: Progress<'a>,
    stop: &'a (dyn Fn() -> bool + Sync),
}

impl Caller<'_> {
    /// Tells how far the work is, and fails if it is to stop.
    fn tell(&self, stage: &str, done: usize, total: usize) -> Result<(), SimulationError> {
        (self.progress)(stage, done, total);
        if (self.stop)() { Err(SimulationError::Stopped) } else { Ok(()) }
    }
}

/// Captures everything a spec describes and writes the rig folder `out`: patterns, sweep, scenes and sequences with
/// their ground truth, and the spec itself as `simulation.toml` (with a film's picture beside it). The folder is
/// written whole or not at all; an earlier simulation in its place is replaced, anything else is not.
///
/// `progress` is told the stage, how many of its shots are done, and how many there are.
///
/// # Errors
///
/// A value of the spec makes no sense, the board cannot be printed, or a file cannot be written.
pub fn simulate(spec: &Spec, out: &Path, progress: Progress) -> Result<(), SimulationError> {
    simulate_until(spec, out, progress, &|| false)
}

/// Captures everything a spec describes as [`simulate`] does, until `stop` says true, which it is asked before every
/// shot; then nothing is left behind.
///
/// # Errors
///
/// As [`simulate`], or the caller stopped the work.
pub fn simulate_until(
    spec: &Spec,
    out: &Path,
    progress: Progress,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(), SimulationError> {
    let caller = Caller { progress, stop };
    spec.check()?;
    let board = spec.board.board();
    let printed = PrintedBoard::of_spec(spec)?;
    let folder = OutputDir::create(out, SPEC_FILE)?;
    let root = folder.path();
    let saved = save_film(spec, root)?;
    write_atomic(&root.join(SPEC_FILE), |w| w.write_all(saved.to_toml().as_bytes()))?;

    let displayed = DisplayedImages::new(spec)?;
    if let LightSpec::Projector(p) = &spec.light {
        write_patterns(&root.join("patterns"), &displayed.images, [p.width, p.height])?;
    }
    let images: Vec<Image> = displayed.images.iter().map(|p| p.image.clone()).collect();
    let light = LightSource::new(spec, &images);
    let renderer = Renderer::new(spec);
    let poses = sweep_poses(spec);
    let rig = rig(spec, root, &board, &poses, &displayed, &renderer, &light);
    rig.save()?;

    let camera = VirtualCamera { spec, renderer: &renderer, light: &light, sensor: Sensor::new(&spec.camera) };
    capture_sweep(&camera, &rig, &poses, &printed, &displayed, caller)?;
    capture_scenes(&camera, &rig, &printed, &displayed, &images, caller)?;
    capture_sequences(&camera, &rig, &displayed, caller)?;
    folder.commit()?;
    Ok(())
}

/// Returns the rig as its file describes it.
fn rig(
    spec: &Spec,
    root: &Path,
    board: &Board,
    poses: &[KnownPose],
    displayed: &DisplayedImages,
    renderer: &Renderer,
    light: &LightSource,
) -> Rig {
    Rig {
        root: root.to_path_buf(),
        name: spec.name.clone(),
        camera: renderer.camera().clone(),
        camera_file: "camera.json".into(),
        channels: spec.camera.channels().expect("checked with the spec"),
        response: None,
        black_level: spec.camera.black_level,
        saturation: spec.camera.saturation(),
        white: "white.png".into(),
        black: "black.png".into(),
        pattern_sets: displayed.sets.clone(),
        board: Some(board.clone()),
        poses: if spec.sweep.write_poses() { poses.to_vec() } else { Vec::new() },
        projector: light.projector(),
        memory: None,
    }
}

fn capture_sweep(
    camera: &VirtualCamera,
    rig: &Rig,
    poses: &[KnownPose],
    printed: &PrintedBoard,
    displayed: &DisplayedImages,
    caller: Caller<'_>,
) -> Result<(), SimulationError> {
    // The sweep needs no inverse images: only decoders of scenes do.
    let frames = displayed.shot_images(true, false);
    for (i, pose) in poses.iter().enumerate() {
        caller.tell("sweep", i, poses.len())?;
        let scene = VirtualScene::of_board(printed, &pose.cam_from_board, &hands_at(camera.spec, i));
        camera.capture(&scene, &frames, i as u64, &rig.root.join("calibration").join(&pose.position))?;
    }
    caller.tell("sweep", poses.len(), poses.len())?;
    Ok(())
}

fn capture_scenes(
    camera: &VirtualCamera,
    rig: &Rig,
    printed: &PrintedBoard,
    displayed: &DisplayedImages,
    images: &[Image],
    caller: Caller<'_>,
) -> Result<(), SimulationError> {
    let scenes = &camera.spec.scenes;
    for (i, spec) in scenes.iter().enumerate() {
        caller.tell("scenes", i, scenes.len())?;
        let scene = stage(camera.spec, spec, printed)?;
        let mut light = LightSource::new(camera.spec, images);
        light.move_by(&light_motion(camera.spec, spec));
        let camera = VirtualCamera { light: &light, sensor: Sensor::new(&camera.spec.camera), ..*camera };
        let dir = rig.root.join("scenes").join(&spec.name);
        let frames = displayed.shot_images(spec.black, true);
        camera.capture(&scene, &frames, FIRST_SCENE_SHOT + i as u64, &dir)?;
        let truth = GroundTruth::new(camera.renderer.camera(), &scene, camera.light);
        write_truth(&dir.join("truth"), rig, &truth)?;
    }
    caller.tell("scenes", scenes.len(), scenes.len())?;
    Ok(())
}

fn capture_sequences(
    camera: &VirtualCamera,
    rig: &Rig,
    displayed: &DisplayedImages,
    caller: Caller<'_>,
) -> Result<(), SimulationError> {
    for (i, sequence) in camera.spec.sequences.iter().enumerate() {
        let patterns = displayed.set_images(sequence.pattern_set.as_deref());
        for frame in 0..sequence.frames {
            caller.tell(&sequence.name, frame, sequence.frames)?;
            let shot = FIRST_SEQUENCE_SHOT + ((i as u64) << 20) + frame as u64;
            let dir = rig.root.join("sequences").join(&sequence.name).join(frame_name(frame, sequence.frames));
            let truth = capture_frame(camera, sequence, frame, &patterns, shot, &dir)?;
            write_truth(&dir.join("truth"), rig, &truth)?;
        }
        caller.tell(&sequence.name, sequence.frames, sequence.frames)?;
    }
    Ok(())
}

/// Returns a frame's name: its number, with as many digits as the last one needs, at least three.
fn frame_name(frame: usize, frames: usize) -> String {
    let digits = (frames - 1).to_string().len().max(3);
    format!("{frame:0digits$}")
}

/// Returns the spec as it is saved: a film's picture is copied beside it, so that the rig can be made again from
/// itself.
fn save_film(spec: &Spec, root: &Path) -> Result<Spec, SimulationError> {
    let mut saved = spec.clone();
    if let LightSpec::Film(FilmSpec { image: Some(image), .. }) = &mut saved.light {
        let name = Path::new("film").with_extension(image.extension().unwrap_or_default());
        std::fs::copy(&*image, root.join(&name)).map_err(|e| SpecError::Io { path: image.clone(), source: e })?;
        *image = name;
    }
    Ok(saved)
}

/// Writes ground truth into the folder `dir`, which is created.
fn write_truth(dir: &Path, rig: &Rig, truth: &GroundTruth) -> Result<(), SimulationError> {
    create_dir(dir)?;
    let (w, h) = (rig.camera.width, rig.camera.height);
    nelu3d_scan::npy::write(&dir.join("depth.npy"), &[h, w], &truth.depth)?;
    let mask: Vec<u8> = truth.mask.iter().map(|m| if *m { 255 } else { 0 }).collect();
    write_gray8(&dir.join("mask.png"), w, h, &mask)?;
    truth.mesh.write(&dir.join("mesh.ply"))?;
    Ok(())
}
