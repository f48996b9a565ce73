use std::path::{Path, PathBuf};

use nelu3d_scan::image::{Channels, Raw, RawData, write_png16};
use nelu3d_scan::rig::{MemoryImages, Need, PatternSet, Shot, StoredImage};
use nelu3d_scan::{Camera, Image, Rig};

/// A 4 × 3 image of 16-bit codes.
struct Codes(Vec<u16>);

impl StoredImage for Codes {
    fn size(&self) -> (usize, usize) {
        (4, self.0.len() / 4)
    }

    fn raw(&self) -> Raw {
        Raw { width: 4, height: self.0.len() / 4, channels: 1, data: RawData::U16(self.0.clone()) }
    }
}

fn rig(root: &Path, memory: Option<MemoryImages>) -> Rig {
    Rig {
        root: root.to_path_buf(),
        name: String::new(),
        camera: Camera::pinhole(4, 3, 5.0, 5.0, 1.5, 1.0),
        camera_file: "camera.json".into(),
        channels: Channels::Mono,
        response: None,
        black_level: 10.0,
        saturation: 1010.0,
        white: "white.png".into(),
        black: "black.png".into(),
        pattern_sets: vec![PatternSet { name: "p".into(), images: vec!["p.png".into()], inverse: Vec::new() }],
        board: None,
        poses: Vec::new(),
        projector: None,
        memory,
    }
}

/// Paths of images and their codes.
fn contents(root: &Path, rows: u16) -> Vec<(PathBuf, Vec<u16>)> {
    let shots = ["calibration/10", "calibration/9", "scenes/cup", "sequences/hand/0", "sequences/hand/1"];
    let names = ["white.png", "black.png", "p.png"];
    let all = shots.iter().flat_map(|shot| names.map(|name| root.join(shot).join(name))).enumerate();
    all.map(|(i, path)| (path, (0..4 * rows).map(|p| 10 + 7 * p + i as u16).collect())).collect()
}

fn images(root: &Path, rows: u16) -> MemoryImages {
    let stored = |(path, codes)| (path, Box::new(Codes(codes)) as Box<dyn StoredImage>);
    MemoryImages::new(contents(root, rows).into_iter().map(stored))
}

/// What is read from memory is what is read from files with the same codes.
#[test]
fn memory_reads_as_files_do() {
    let dir = tempfile::tempdir().unwrap();
    let memory = images(dir.path(), 3);
    for (path, codes) in contents(dir.path(), 3) {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let data = codes.iter().map(|c| (f32::from(*c) - 10.0) / 1000.0).collect();
        write_png16(&path, &Image { width: 4, height: 3, channels: 1, data }, 10.0, 1010.0).unwrap();
    }
    let (files, memory) = (rig(dir.path(), None), rig(dir.path(), Some(memory)));
    let names = |shots: Vec<Shot>| shots.into_iter().map(|s| s.name).collect::<Vec<_>>();
    assert_eq!(names(memory.positions().unwrap()), ["9", "10"]);
    assert_eq!(memory.positions().unwrap(), files.positions().unwrap());
    assert_eq!(memory.scenes().unwrap(), files.scenes().unwrap());
    assert_eq!(names(memory.sequence("hand").unwrap()), ["0", "1"]);
    assert_eq!(memory.sequence("hand").unwrap(), files.sequence("hand").unwrap());
    let (scene, set) = (memory.scene("cup").unwrap(), memory.pattern_set(None).unwrap());
    assert_eq!(memory.read_shot(&scene, set, Need::Scene).unwrap(), files.read_shot(&scene, set, Need::Scene).unwrap());
    assert!(memory.has_image(&scene.dir.join("p.png")) && !memory.has_image(&scene.dir.join("q.png")));
}

/// Nothing is looked for on the disk, and images of another size are refused as files are.
#[test]
fn what_memory_lacks_is_named() {
    let root = Path::new("arrays");
    let rig_of = |rows| rig(root, Some(images(root, rows)));
    let small = rig_of(2);
    let error = small.read_image(&root.join("scenes/cup/white.png")).unwrap_err().to_string();
    assert!(error.contains("white.png") && error.contains("4x2"), "{error}");
    let error = rig_of(3).read_image(&root.join("scenes/cup/q.png")).unwrap_err().to_string();
    assert!(error.contains("q.png") && error.contains("no such image"), "{error}");
    assert!(rig_of(3).scene("mug").unwrap_err().to_string().contains("the rig has: cup"));
}
