//! Writing a virtual scanner's captures as an ordinary rig folder.

use std::collections::HashMap;
use std::io;
use std::path::Path;

use nelu3d_scan::Image;
use nelu3d_scan::board::{Artwork, BoardError};
use nelu3d_scan::image::{write_gray8, write_png8, write_png16};
use nelu3d_scan::mesh::MeshFileError;
use nelu3d_scan::output::{OutputDir, create_dir, write_atomic};
use nelu3d_scan::pattern::{self, PatternImage};
use nelu3d_scan::rig::{PatternSet, Rig, RigError};
use rayon::prelude::*;

use crate::light::{Frame, Light};
use crate::random::{Use, generator};
use crate::render::Renderer;
use crate::scene::Scene;
use crate::sensor::Sensor;
use crate::spec::{LightSpec, Spec, SpecError};
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

/// Captures everything a spec describes and writes the rig folder `out`: patterns, sweep, scenes with their truth, and the
/// spec itself as `simulation.toml`. The folder is written whole or not at all; an earlier simulation in its place is
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
    write_atomic(&root.join(SPEC_FILE), |w| w.write_all(spec.to_toml().as_bytes()))?;

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
        let scene = Scene::of_board(&board, artwork.clone(), spec.board_albedo, &pose.cam_from_board);
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
    folder.commit()?;
    Ok(())
}

/// The images a light source shows, and the sets they belong to.
struct Shown {
    /// Every different image once, named as its file without extension; codes as the projector has them.
    images: Vec<PatternImage>,
    /// How many of `images`, from the first, are no inverses.
    n_patterns: usize,
    sets: Vec<PatternSet>,
}

impl Shown {
    fn new(spec: &Spec) -> Result<Self, SpecError> {
        let (width, height) = match &spec.light {
            LightSpec::Projector(p) => (p.width, p.height),
            LightSpec::Film(_) => {
                let image = PatternImage { name: "pattern".into(), image: Image::new(0, 0, 3) };
                let set = PatternSet { name: "film".into(), images: vec!["pattern.png".into()], inverse: Vec::new() };
                return Ok(Self { images: vec![image], n_patterns: 1, sets: vec![set] });
            }
        };
        let mut made = Vec::new();
        for set in &spec.pattern_sets {
            let images = pattern::generate(&set.patterns, width, height)
                .map_err(|source| SpecError::Pattern { set: set.name.clone(), source })?;
            made.push(images);
        }
        let mut images: Vec<PatternImage> = Vec::new();
        let mut taken: HashMap<String, usize> = HashMap::new();
        let mut place = |p: &PatternImage| {
            let image = eight_bits(&p.image);
            let (stem, number) = p.name.rsplit_once('_').expect("named with a number");
            let first: usize = number.parse().expect("named with a number");
            for number in first.. {
                let name = format!("{stem}_{number:02}");
                match taken.get(&name) {
                    // Sets that show the same image share it.
                    Some(&i) if images[i].image == image => return format!("{name}.png"),
                    Some(_) => {}
                    None => {
                        taken.insert(name.clone(), images.len());
                        let file = format!("{name}.png");
                        images.push(PatternImage { name, image });
                        return file;
                    }
                }
            }
            unreachable!("there are more numbers than images")
        };
        let patterns: Vec<Vec<String>> = made.iter().map(|m| m.images.iter().map(&mut place).collect()).collect();
        let inverses: Vec<Vec<String>> = made.iter().map(|m| m.inverse.iter().map(&mut place).collect()).collect();
        let n_patterns = patterns.iter().flatten().collect::<std::collections::HashSet<_>>().len();
        let sets = patterns
            .into_iter()
            .zip(inverses)
            .zip(&spec.pattern_sets)
            .map(|((images, inverse), set)| PatternSet { name: set.name.clone(), images, inverse })
            .collect();
        Ok(Self { images, n_patterns, sets })
    }

    /// What to capture of a shot, with its file names.
    fn frames(&self, black: bool, inverses: bool) -> Vec<(Frame, String)> {
        let mut frames = vec![(Frame::White, "white.png".to_owned())];
        if black {
            frames.push((Frame::Black, "black.png".into()));
        }
        let n = if inverses { self.images.len() } else { self.n_patterns };
        frames.extend((0..n).map(|i| (Frame::Pattern(i), format!("{}.png", self.images[i].name))));
        frames
    }
}

/// The codes an 8-bit projector has for an image.
fn eight_bits(image: &Image) -> Image {
    let data = image.data.iter().map(|v| (v * 255.0).round() / 255.0).collect();
    Image { data, ..image.clone() }
}

fn write_patterns(dir: &Path, images: &[PatternImage], [width, height]: [usize; 2]) -> io::Result<()> {
    create_dir(dir)?;
    for p in images {
        write_png8(&dir.join(format!("{}.png", p.name)), &p.image, 0.0, 255.0)?;
    }
    write_gray8(&dir.join("white.png"), width, height, &vec![255; width * height])
}

/// The camera before the light.
struct Capture<'a> {
    spec: &'a Spec,
    renderer: &'a Renderer,
    light: &'a Light,
    sensor: Sensor,
}

impl Capture<'_> {
    /// Takes all images of a shot and writes them into the folder `dir`, which is created.
    fn shoot(&self, scene: &Scene, frames: &[(Frame, String)], shot: u64, dir: &Path) -> io::Result<()> {
        create_dir(dir)?;
        let shows: Vec<Frame> = frames.iter().map(|f| f.0).collect();
        let mut images = self.renderer.render(scene, self.light, &shows, shot);
        let camera = &self.spec.camera;
        images.par_iter_mut().zip(frames).enumerate().try_for_each(|(f, (image, (_, file)))| {
            let row_len = image.width * image.channels;
            image.data.par_chunks_mut(row_len).enumerate().for_each(|(y, row)| {
                let mut random = generator(self.spec.seed, Use::Sensor, [shot, f as u64, y as u64]);
                row.iter_mut().for_each(|v| *v = self.sensor.read(*v, &mut random));
            });
            let write = if camera.bits <= 8 { write_png8 } else { write_png16 };
            write(&dir.join(file), image, camera.black_level, camera.saturation())
        })
    }
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
