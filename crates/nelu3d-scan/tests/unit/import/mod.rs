//! Recordings that are written here, imported, and read back with the rig's own reader.

mod complaints;
pub(crate) mod dng;
mod raw;

use std::fs;
use std::path::Path;

use dng::chronos;
use nelu3d_scan::camera::write_camera;
use nelu3d_scan::image::{Channels, Raw, RawData, decode, write_rgb8};
use nelu3d_scan::import::{ImportError, ImportReport, ImportRequest, ImportTarget, run, write_codes};
use nelu3d_scan::rig::{Need, PatternSet};
use nelu3d_scan::{Camera, Rig};

use crate::output::names;

const W: usize = 10;
const H: usize = 6;

/// Codes of the i-th frame, 12 bits.
fn codes(i: usize) -> Vec<u16> {
    (0..W * H).map(|p| ((p * 37 + i * 411) % 4096) as u16).collect()
}

fn gray16(codes: Vec<u16>) -> Raw {
    Raw { width: W, height: H, channels: 1, data: RawData::U16(codes) }
}

/// A folder with `n` frames in a temporary place, whose content `write` makes; and intrinsics beside it.
fn recording(n: usize, ending: &str, write: impl Fn(&Path, usize)) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("frames")).unwrap();
    for i in 0..n {
        write(&dir.path().join(format!("frames/frame_{:06}.{ending}", i + 1)), i);
    }
    write_camera(&dir.path().join("intrinsics.json"), &Camera::pinhole(W, H, 20.0, 20.0, 4.5, 2.5)).unwrap();
    dir
}

fn dngs(n: usize) -> tempfile::TempDir {
    recording(n, "dng", |path, i| fs::write(path, chronos(W, H).bytes(&codes(i))).unwrap())
}

fn tiffs(n: usize) -> tempfile::TempDir {
    recording(n, "tiff", |path, i| write_codes(&gray16(codes(i)), path).unwrap())
}

fn words(order: &str) -> Option<Vec<String>> {
    Some(order.split(',').map(str::to_owned).collect())
}

/// A request for a new rig in that place.
fn request(dir: &Path, target: ImportTarget) -> ImportRequest {
    ImportRequest {
        frames: dir.join("frames"),
        rig: dir.join("rig"),
        target,
        order: words("pattern,white"),
        set: None,
        first: None,
        last: None,
        every: 1,
        mean: false,
        black: None,
        camera: Some(dir.join("intrinsics.json")),
        channels: None,
        black_level: None,
        saturation: None,
        force: false,
    }
}

fn import(request: &ImportRequest) -> Result<ImportReport, ImportError> {
    run(request, &|_, _| true)
}

fn sequence(name: &str) -> ImportTarget {
    ImportTarget::Sequence(name.into())
}

fn u16s(path: &Path) -> Vec<u16> {
    match decode(path, Some((W, H))).unwrap().data {
        RawData::U16(v) => v,
        other => panic!("{other:?}"),
    }
}

#[test]
fn chronos_recordings_become_a_new_rig() {
    let dir = dngs(7);
    fs::write(dir.path().join("frames/._frame_000001.dng"), "macOS was here").unwrap();
    fs::write(dir.path().join("frames/notes.txt"), "not a frame").unwrap();
    let seen = std::sync::Mutex::new(Vec::new());
    let report = run(&request(dir.path(), sequence("ball")), &|done, total| {
        seen.lock().unwrap().push((done, total));
        true
    })
    .unwrap();
    assert_eq!((report.groups, report.folders, report.frames, report.left_over), (3, 3, 6, 1));
    assert_eq!(report.range, ["frame_000001.dng", "frame_000006.dng"]);
    assert!(report.new_rig && report.notes.iter().any(|n| n.contains("the last 1 of 7 frames")), "{:?}", report.notes);
    assert!(report.notes.iter().any(|n| n.contains("[board]")));
    assert!(seen.into_inner().unwrap().contains(&(6, 6)));

    let rig = Rig::open(&dir.path().join("rig")).unwrap();
    assert_eq!((rig.channels, rig.black_level, rig.saturation), (Channels::Bayer([1, 0, 2, 1]), 0.0, 4095.0));
    let set = rig.pattern_set(None).unwrap();
    assert_eq!(*set, PatternSet { name: "recorded".into(), images: vec!["pattern.png".into()], inverse: vec![] });
    let frames = rig.sequence("ball").unwrap();
    assert_eq!(frames.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["0000", "0001", "0002"]);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(names(&frame.dir), ["pattern.png", "white.png"]);
        assert_eq!(u16s(&frame.dir.join("pattern.png")), codes(2 * i));
        assert_eq!(u16s(&frame.dir.join("white.png")), codes(2 * i + 1));
        assert_eq!(rig.read_shot(frame, set, Need::Scene).unwrap().white.channels, 3);
    }
    let text = fs::read_to_string(dir.path().join("rig/sequences/ball/import.json")).unwrap();
    let kept: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((kept["frames"].as_u64(), kept["order"][1].as_str()), (Some(6), Some("white.png")));
}

#[test]
fn png_and_tiff_stay_as_they_are() {
    let color = |path: &Path, i: usize| write_rgb8(path, W, H, &[10 * i as u8 + 5; 3 * W * H]).unwrap();
    let rgb = recording(2, "png", color);
    let report = import(&request(rgb.path(), ImportTarget::Scene("cup".into()))).unwrap();
    assert_eq!((report.channels.as_str(), report.saturation), ("rgb", 255.0));
    let gray = tiffs(2);
    let report = import(&ImportRequest {
        channels: Some(Channels::Mono),
        ..request(gray.path(), ImportTarget::Scene("cup".into()))
    })
    .unwrap();
    assert_eq!((report.channels.as_str(), report.saturation), ("mono", 4095.0));
    assert!(report.notes.iter().any(|n| n.contains("a guess")), "{:?}", report.notes);
    for (dir, ending) in [(rgb, "png"), (gray, "tiff")] {
        let rig = Rig::open(&dir.path().join("rig")).unwrap();
        assert_eq!(rig.white, format!("white.{ending}"));
        let cup = rig.scene("cup").unwrap();
        rig.read_shot(&cup, rig.pattern_set(None).unwrap(), Need::Scene).unwrap();
        let source = fs::read(dir.path().join(format!("frames/frame_000002.{ending}"))).unwrap();
        assert_eq!(fs::read(cup.dir.join(&rig.white)).unwrap(), source);
    }
}

#[test]
fn an_old_rig_says_what_the_frames_are() {
    let dir = tiffs(6);
    let mut rig = Rig {
        root: dir.path().join("rig"),
        name: String::new(),
        camera: Camera::pinhole(W, H, 20.0, 20.0, 4.5, 2.5),
        camera_file: "camera.json".into(),
        channels: Channels::Mono,
        response: None,
        black_level: 0.0,
        saturation: 4095.0,
        white: "flash.png".into(),
        black: "black.png".into(),
        pattern_sets: ["one", "two"]
            .map(|name| PatternSet {
                name: name.into(),
                images: [format!("{name}_a.png"), format!("{name}_b.png")].into(),
                inverse: vec![],
            })
            .into(),
        board: None,
        poses: vec![],
        projector: None,
        memory: None,
    };
    rig.save().unwrap();
    let by_set = ImportRequest {
        order: None,
        camera: None,
        set: Some("two".into()),
        rig: rig.root.join("rig.toml"),
        ..request(dir.path(), ImportTarget::Calibration)
    };
    let report = import(&by_set).unwrap();
    assert!(!report.new_rig && report.levels.is_none());
    assert!(report.notes.iter().any(|n| n.contains("no black.png")), "{:?}", report.notes);
    let positions = rig.positions().unwrap();
    assert_eq!(positions.len(), 2);
    for (i, p) in positions.iter().enumerate() {
        for (j, name) in ["two_a.png", "two_b.png", "flash.png"].iter().enumerate() {
            assert_eq!(u16s(&p.dir.join(name)), codes(3 * i + j));
        }
    }
    // By words: names with or without their ending; and every second group of two.
    let by_words = ImportRequest {
        order: words("white,skip"),
        every: 2,
        target: sequence("s"),
        set: None,
        rig: rig.root.clone(),
        ..by_set.clone()
    };
    let report = import(&by_words).unwrap();
    assert_eq!((report.folders, report.groups), (2, 2));
    assert!(report.notes.iter().any(|n| n.contains("`two` lacks two_a.png, two_b.png")), "{:?}", report.notes);
    let frames = rig.sequence("s").unwrap();
    assert_eq!(u16s(&frames[1].dir.join("flash.png")), codes(4));
    // TIFF under a name that says TIFF, from DNG.
    let raw = dngs(2);
    rig.channels = Channels::Bayer([1, 0, 2, 1]);
    rig.black = "black.tiff".into();
    rig.save().unwrap();
    let scene = ImportRequest { order: words("black,one_a.png"), frames: raw.path().join("frames"), ..by_words };
    import(&ImportRequest { target: ImportTarget::Scene("x".into()), every: 1, ..scene }).unwrap();
    let dark = rig.scene("x").unwrap().dir.join("black.tiff");
    assert!(fs::read(&dark).unwrap().starts_with(b"II"));
    assert_eq!(u16s(&dark), codes(0));
}

#[test]
fn groups_are_averaged() {
    let dir = tiffs(6);
    let mean = ImportRequest {
        mean: true,
        channels: Some(Channels::Mono),
        ..request(dir.path(), ImportTarget::Scene("still".into()))
    };
    let report = import(&mean).unwrap();
    assert_eq!((report.groups, report.folders), (3, 1));
    let (a, b, c) = (codes(1), codes(3), codes(5));
    let expected: Vec<u16> = (0..W * H)
        .map(|i| (f64::from(u32::from(a[i]) + u32::from(b[i]) + u32::from(c[i])) / 3.0).round() as u16)
        .collect();
    assert_eq!(u16s(&dir.path().join("rig/scenes/still/white.tiff")), expected);
    // One position of a burst, with the light off taken apart.
    let dark = tiffs(2);
    let position = ImportRequest {
        target: ImportTarget::Calibration,
        camera: None,
        channels: None,
        black: Some(dark.path().join("frames")),
        ..mean
    };
    let report = import(&position).unwrap();
    assert_eq!(report.folders, 1);
    let rig = Rig::open(&dir.path().join("rig")).unwrap();
    let positions = rig.positions().unwrap();
    rig.read_shot(&positions[0], rig.pattern_set(None).unwrap(), Need::Calibration).unwrap();
    let half: Vec<u16> = codes(0).iter().zip(codes(1)).map(|(&a, b)| (a + b).div_ceil(2)).collect();
    assert_eq!(u16s(&positions[0].dir.join("black.tiff")), half);
}

#[test]
fn a_range_of_frames_and_options_of_the_sensor() {
    let dir = dngs(9);
    let ranged = ImportRequest {
        first: Some(4),
        last: Some(7),
        black_level: Some(16.0),
        saturation: Some(4000.0),
        channels: Some(Channels::Bayer([1, 2, 0, 1])),
        set: Some("mine".into()),
        ..request(dir.path(), sequence("part"))
    };
    let report = import(&ranged).unwrap();
    assert_eq!((report.range, report.groups), (["frame_000004.dng".into(), "frame_000007.dng".into()], 2));
    assert_eq!(report.levels, None);
    let rig = Rig::open(&dir.path().join("rig")).unwrap();
    assert_eq!((rig.black_level, rig.saturation, rig.channels.name().as_str()), (16.0, 4000.0, "bayer-gbrg"));
    assert_eq!(rig.pattern_sets[0].name, "mine");
    assert_eq!(u16s(&rig.sequence("part").unwrap()[0].dir.join("pattern.png")), codes(3));
}

#[test]
fn earlier_imports_are_replaced_only_by_force() {
    let dir = dngs(4);
    let first = request(dir.path(), sequence("ball"));
    import(&first).unwrap();
    let again = ImportRequest { camera: None, last: Some(2), ..first };
    let e = import(&again).unwrap_err().to_string();
    assert!(e.contains("sequences/ball: exists") && e.contains("--force"), "{e}");
    let forced = ImportRequest { force: true, ..again };
    import(&forced).unwrap();
    assert_eq!(names(&dir.path().join("rig/sequences/ball")), ["0000", "import.json"]);
    // Frames that nobody imported stay.
    fs::remove_file(dir.path().join("rig/sequences/ball/import.json")).unwrap();
    let e = import(&forced).unwrap_err().to_string();
    assert!(e.contains("is not an earlier result"), "{e}");
    assert_eq!(names(&dir.path().join("rig/sequences")), ["ball"]);
}
