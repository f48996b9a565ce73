//! A rig folder written, opened and read; and every complaint about one.

mod memory;
mod mono;
mod mosaic;
mod names;
mod shots;

mod checks;
mod response;

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Vector3};
use nelu3d_scan::board::{Board, BoardKind, Marker};
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::image::{Channels, write_png8, write_png16, write_rgb8};
use nelu3d_scan::rig::{KnownPose, Need, PatternSet, RigError, Shot};
use nelu3d_scan::{Camera, Image, Projector, Rig};

const W: usize = 12;
const H: usize = 8;

fn markers() -> Vec<Marker> {
    let square = |x: f64, y: f64| [[x, y], [x + 30.0, y], [x + 30.0, y + 30.0], [x, y + 30.0]];
    vec![Marker { id: 0, corners_mm: square(-50.0, 0.0) }, Marker { id: 7, corners_mm: square(20.5, 40.0) }]
}

fn boards() -> [Board; 3] {
    let dictionary = "DICT_4X4_250".to_owned();
    let (columns, rows, square_mm) = (12, 9, 20.0);
    let charuco =
        BoardKind::Charuco { columns, rows, square_mm, marker_mm: 15.0, dictionary: dictionary.clone(), legacy: true };
    [
        Board { kind: charuco, extent_mm: [0.0, 0.0, 240.0, 180.0], scale: [1.0, 1.0] },
        Board {
            kind: BoardKind::Chessboard { columns, rows, square_mm },
            extent_mm: [-10.0, -10.0, 250.0, 190.0],
            scale: [0.996, 0.998],
        },
        Board {
            kind: BoardKind::Markers { dictionary, markers: markers() },
            extent_mm: [-50.0, 0.0, 50.5, 70.0],
            scale: [1.0, 1.0],
        },
    ]
}

/// A small rig in `root`: a description and no images.
fn rig_at(root: &Path) -> Rig {
    let distortion = Distortion::new(&[-0.1, 0.05, 1e-3, -2e-3, 0.0]).unwrap();
    Rig {
        root: root.to_path_buf(),
        name: "a \"small\" rig".into(),
        camera: Camera { distortion, ..Camera::pinhole(W, H, 30.25, 30.5, 5.5, 3.5) },
        camera_file: "camera.json".into(),
        channels: Channels::Mono,
        response: None,
        black_level: 10.0,
        saturation: 4095.0,
        white: "white.png".into(),
        black: "black.png".into(),
        pattern_sets: vec![
            PatternSet { name: "two".into(), images: vec!["a.png".into(), "b.png".into()], inverse: vec![] },
            PatternSet { name: "gray".into(), images: vec!["a.png".into()], inverse: vec!["a_inv.png".into()] },
        ],
        board: Some(boards()[0].clone()),
        poses: vec![],
        projector: None,
        memory: None,
    }
}

/// Fills a folder with 16-bit captures.
fn shoot(rig: &Rig, dir: &Path, names: &[&str]) {
    fs::create_dir_all(dir).unwrap();
    for name in names {
        let value = match *name {
            "black.png" => 0.02,
            "white.png" => 0.8,
            _ => 0.4,
        };
        let image = Image { data: vec![value; W * H], ..Image::new(W, H, 1) };
        write_png16(&dir.join(name), &image, rig.black_level, rig.saturation).unwrap();
    }
}

/// A whole rig: three positions, a scene, a sequence of two frames.
fn whole_rig(root: &Path) -> Rig {
    let rig = rig_at(root);
    rig.save().unwrap();
    for p in ["2", "10", "1"] {
        shoot(&rig, &root.join("calibration").join(p), &["white.png", "black.png", "a.png", "b.png"]);
    }
    shoot(&rig, &root.join("scenes/cup"), &["white.png", "a.png", "b.png", "a_inv.png"]);
    for f in ["000", "001"] {
        shoot(&rig, &root.join("sequences/wave").join(f), &["white.png", "black.png", "a.png", "b.png", "a_inv.png"]);
    }
    rig
}

fn names(shots: &[Shot]) -> Vec<&str> {
    shots.iter().map(|s| s.name.as_str()).collect()
}

fn complaint<T: std::fmt::Debug>(result: Result<T, RigError>, file: &str, expected: &str) {
    let e = result.unwrap_err().to_string();
    assert!(e.contains(file) && e.contains(expected), "`{e}` should name {file} and say: {expected}");
}

#[test]
fn rigs_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    for (i, board) in boards().into_iter().enumerate() {
        for channels in Channels::ALL {
            let root = dir.path().join(format!("{i}-{}", channels.name()));
            let rig = Rig { board: Some(board.clone()), channels, ..rig_at(&root) };
            rig.save().unwrap();
            assert_eq!(Rig::open(&root).unwrap(), rig);
            assert_eq!(Rig::open(&root.join("rig.toml")).unwrap(), rig);
        }
    }
}

#[test]
fn poses_and_projector_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let pose = |i: f64| Isometry3::new(Vector3::new(1.0, 2.0, 300.0 + i), Vector3::new(0.1, -0.2 * i, 3.0));
    let mut rig = rig_at(&dir.path().join("deep/er"));
    rig.poses = vec![
        KnownPose { position: "000".into(), cam_from_board: pose(0.0) },
        KnownPose { position: "001".into(), cam_from_board: pose(1.0) },
    ];
    rig.projector =
        Some(Projector { optics: Camera::pinhole(64, 48, 50.0, 50.0, 32.0, 24.0), proj_from_cam: pose(0.5) });
    rig.save().unwrap();
    let back = Rig::open(&rig.root).unwrap();
    let close = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        a.translation == b.translation && a.rotation.angle_to(&b.rotation) < 1e-12
    };
    assert!(back.poses.iter().zip(&rig.poses).all(|(a, b)| close(&a.cam_from_board, &b.cam_from_board)));
    assert!(close(back.known_pose("001").unwrap(), &pose(1.0)) && back.known_pose("2").is_none());
    let (a, b) = (back.projector.unwrap(), rig.projector.unwrap());
    assert!(a.optics == b.optics && close(&a.proj_from_cam, &b.proj_from_cam));
}

#[test]
fn shots_are_found_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let rig = whole_rig(dir.path());
    fs::create_dir(dir.path().join("calibration/.hidden.partial-7")).unwrap();
    assert_eq!(names(&rig.positions().unwrap()), ["1", "2", "10"]);
    assert_eq!(names(&rig.sequence("wave").unwrap()), ["000", "001"]);
    let cup = rig.scene("cup").unwrap();
    let by_path = rig.scene(dir.path().join("scenes/cup").to_str().unwrap()).unwrap();
    assert_eq!(by_path, cup);

    let set = rig.pattern_set(None).unwrap();
    assert_eq!((set.name.as_str(), rig.channels_of(set)), ("two", 2));
    let gray = rig.pattern_set(Some("gray")).unwrap();
    let c = rig.read_shot(&cup, set, Need::Scene).unwrap();
    assert!(c.black.is_none() && c.patterns.len() == 2);
    assert!((c.white.pixel(3, 2)[0] - 0.8).abs() < 2e-4 && (c.patterns[1].pixel(0, 0)[0] - 0.4).abs() < 2e-4);
    assert_eq!(rig.read_inverse(&cup, gray).unwrap().len(), 1);
    let c = rig.read_shot(&rig.positions().unwrap()[0], set, Need::Calibration).unwrap();
    assert!((c.black.unwrap().pixel(0, 0)[0] - 0.02).abs() < 2e-4);

    complaint(rig.read_shot(&cup, set, Need::Calibration), "cup/black.png", "no such image");
    complaint(rig.read_inverse(&rig.positions().unwrap()[0], gray), "1/a_inv.png", "no such image");
    complaint(rig.scene("mug"), "mug", "the rig has: cup");
    complaint(rig.scene(""), "scene", "the rig has: cup");
    complaint(rig.sequence("run"), "run", "the rig has: wave");
    complaint(rig.pattern_set(Some("three")), "rig.toml", "it has: two, gray");
    fs::create_dir(dir.path().join("sequences/still")).unwrap();
    complaint(rig.sequence("still"), "still", "has no frames");
    let empty = rig_at(&dir.path().join("nothing"));
    complaint(empty.positions(), "calibration", "no calibration sweep");
    complaint(empty.scene("x"), "x", "the rig has none");
}

#[test]
fn images_that_do_not_fit_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let rig = whole_rig(dir.path());
    let set = &rig.pattern_sets[0].clone();
    let cup = rig.scene("cup").unwrap();
    let white = cup.dir.join("white.png");

    write_rgb8(&white, W, H, &[9; W * H * 3]).unwrap();
    complaint(rig.read_shot(&cup, set, Need::Scene), "cup/white.png", "three channels");
    write_png16(&white, &Image::new(W + 1, H, 1), 0.0, 4095.0).unwrap();
    complaint(rig.read_shot(&cup, set, Need::Scene), "cup/white.png", "13x8 pixels, but its intrinsics say 12x8");
    fs::write(&white, &fs::read(cup.dir.join("a.png")).unwrap()[..60]).unwrap();
    complaint(rig.read_shot(&cup, set, Need::Scene), "cup/white.png", "truncated or damaged");

    // Both depths can reach this saturation, yet they must not be mixed.
    let rig = Rig { saturation: 255.0, ..rig };
    write_png8(&white, &Image::new(W, H, 1), 0.0, 255.0).unwrap();
    let e = rig.read_shot(&cup, set, Need::Scene).unwrap_err().to_string();
    assert!(e.contains("cup/a.png: is 16-bit, but") && e.contains("cup/white.png is 8-bit"), "{e}");
}

#[test]
fn mistakes_in_rig_toml_are_named() {
    let dir = tempfile::tempdir().unwrap();
    rig_at(dir.path()).save().unwrap();
    let file = dir.path().join("rig.toml");
    let good = fs::read_to_string(&file).unwrap();
    for (from, to, expected) in [
        ("format = 1", "format = 2\nlens = 3", "`format` is 2, but this program knows up to 1"),
        ("format = 1", "format = 0", "`format` is 0"),
        ("format = 1\n", "", "missing field `format`"),
        ("format = 1", "format = 1\nlens = 3", "unknown field `lens`"),
        ("black_level =", "blacklevel =", "unknown field `blacklevel`"),
        ("[board]", "[board]\ncolour = 1", "unknown field `colour`"),
        ("name = \"two\"", "name = \"two\"\nk = 2", "unknown field `k`"),
        ("[camera]", "[camera", "line 4"),
        (
            "channels = \"mono\"",
            "channels = \"gray\"",
            "`camera.channels` is \"gray\"; it must be one of: mono, rgb, bayer-rggb",
        ),
        ("saturation = 4095.0", "saturation = 10", "`camera.saturation` is 10"),
        ("saturation = 4095.0", "saturation = nan", "`camera.saturation` is NaN"),
        ("white = \"white.png\"", "white = \"\"", "`images.white` is empty"),
        ("name = \"gray\"", "name = \"two\"", "is used twice"),
        (
            "name = \"gray\"",
            "name = \"../../gray\"",
            "`pattern_sets.name` is \"../../gray\"; it becomes the name of a file",
        ),
        ("name = \"gray\"", "name = \"/tmp/gray\"", "`pattern_sets.name` is \"/tmp/gray\""),
        (
            "white = \"white.png\"",
            "white = \"/dev/zero\"",
            "`images.white` is \"/dev/zero\"; give the name of a file that",
        ),
        ("white = \"white.png\"", "white = \"../white.png\"", "`images.white` is \"../white.png\""),
        ("black = \"black.png\"", "black = \"white.png\"", "`images.black` is the same image as images.white"),
        ("white = \"white.png\"", "white = \"a.png\"", "`two`: images` lists \"a.png\", which is the light at its"),
        (
            "images = [\"a.png\", \"b.png\"]",
            "images = [\"white.png\"]",
            "lists \"white.png\", which is the light at its",
        ),
        (
            "images = [\"a.png\", \"b.png\"]",
            "images = [\"a.png\", \"a.png\"]",
            "lists \"a.png\" twice; list each image once",
        ),
        ("inverse = [\"a_inv.png\"]", "inverse = [\"a.png\"]", "lists \"a.png\" as its own inverse"),
        (
            "[board]",
            "[board]\nextent_mm = [900, 900, 950, 950]",
            "far beside the print, which is within [0.0, 0.0, 240.0",
        ),
        ("images = [\"a.png\", \"b.png\"]", "images = []", "pattern_sets `two`: images` is empty"),
        ("inverse = [\"a_inv.png\"]", "inverse = [\"x.png\", \"y.png\"]", "lists 2 files for 1 images"),
        ("kind = \"charuco\"", "kind = \"circles\"", "`board.kind` is \"circles\""),
        ("kind = \"charuco\"", "kind = \"chessboard\"", "`board.marker_mm` does not belong here"),
        ("marker_mm = 15.0\n", "", "`board.marker_mm` is missing"),
        ("marker_mm = 15.0", "marker_mm = 20.0", "`board.marker_mm` is 20"),
        ("square_mm = 20.0", "square_mm = -20.0", "`board.square_mm` is -20"),
        ("square_mm = 20.0", "square_mm = nan", "`board.square_mm` is NaN"),
        ("columns = 12", "columns = 1", "`board.columns` is 1"),
        ("columns = 12", "columns = -1", "line"),
        (
            "dictionary = \"DICT_4X4_250\"",
            "dictionary = \"\"",
            "`board.dictionary` is \"\"; it must be one of: DICT_4X4",
        ),
        ("dictionary = \"DICT_4X4_250\"", "dictionary = \"DICT_9X9_50\"", "`board.dictionary` is \"DICT_9X9_50\""),
        ("dictionary = \"DICT_4X4_250\"", "dictionary = \"DICT_4X4_50\"", "54 white squares"),
        ("[board]", "[board]\nextent_mm = [5, 0, 5, 10]", "`board.extent_mm` is [5.0, 0.0, 5.0, 10.0]"),
        ("camera.json", "lens.json", "lens.json: there is no such file"),
    ] {
        assert!(good.contains(from), "the test is stale: {from} is not in\n{good}");
        fs::write(&file, good.replacen(from, to, 1)).unwrap();
        complaint(
            Rig::open(dir.path()),
            if expected.contains("lens.json") { "lens.json" } else { "rig.toml" },
            expected,
        );
    }
    complaint(Rig::open(&dir.path().join("none")), "none", "is no rig");
    complaint(Rig::open(&dir.path().join("none/rig.toml")), "none/rig.toml", "is no rig");
}

#[test]
fn markers_and_poses_are_judged() {
    let dir = tempfile::tempdir().unwrap();
    let with = |change: &dyn Fn(&mut Vec<Marker>)| {
        let mut markers = markers();
        change(&mut markers);
        let board = Board {
            kind: BoardKind::Markers { dictionary: "DICT_4X4_50".into(), markers },
            extent_mm: [0.0, 0.0, 1.0, 1.0],
            scale: [1.0, 1.0],
        };
        Rig { board: Some(board), ..rig_at(dir.path()) }.save()
    };
    with(&|_| ()).unwrap();
    complaint(with(&|m| m[1].id = 0), "rig.toml", "`board.markers, id 0` is listed twice");
    complaint(with(&|m| m.clear()), "rig.toml", "`board.markers` is empty");
    complaint(
        with(&|m| m[1].corners_mm = [[1.0, 1.0]; 4]),
        "rig.toml",
        "`board.markers, id 7` has corners_mm without an area",
    );
    complaint(with(&|m| m[0].corners_mm[0][0] = f64::NAN), "rig.toml", "`board.markers, id 0`");

    let pose = KnownPose { position: "0".into(), cam_from_board: Isometry3::identity() };
    let twice = Rig { poses: vec![pose.clone(), pose], ..rig_at(dir.path()) };
    complaint(twice.save(), "rig.toml", "`poses `0`` is given twice");
    // Whatever cannot be read back was not written either.
    assert_eq!(Rig::open(dir.path()).unwrap().board.unwrap().extent_mm, [0.0, 0.0, 1.0, 1.0]);
}

/// The shared rigs, if this machine has them.
fn shared_rigs() -> Vec<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let rigs: Vec<PathBuf> = ["dlp", "film", "david"].iter().map(|n| data.join(n)).filter(|p| p.is_dir()).collect();
    if rigs.is_empty() {
        eprintln!("SKIPPED: no shared rigs in {}", data.display());
    }
    rigs
}

#[test]
fn shared_rigs_open() {
    for root in shared_rigs() {
        let rig = Rig::open(&root).unwrap();
        let set = rig.pattern_set(None).unwrap();
        assert_eq!(rig.channels_of(set), 3);
        for scene in rig.scenes().unwrap() {
            let c = rig.read_shot(&scene, set, Need::Scene).unwrap();
            let mean = |i: &Image| i.data.iter().map(|&v| f64::from(v)).sum::<f64>() / i.data.len() as f64;
            assert!(mean(&c.white) > mean(&c.patterns[0]), "{}: white is not the brightest", scene.dir.display());
        }
        if root.join("calibration").is_dir() {
            let position = &rig.positions().unwrap()[0];
            rig.read_shot(position, set, Need::Calibration).unwrap();
        }
        // Written elsewhere, the description is the same.
        let copy = tempfile::tempdir().unwrap();
        let moved = Rig { root: copy.path().to_path_buf(), ..rig };
        moved.save().unwrap();
        let back = Rig::open(copy.path()).unwrap();
        assert_eq!(Rig { projector: None, ..back }, Rig { projector: None, ..moved });
    }
}
