//! `nelu3d patterns` as a person meets it: images on disk, a snippet for rig.toml, scores, and one sentence an error.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use nelu3d_scan::Image;
use nelu3d_scan::image::{Depth, decode, read_any, write_png8};
use nelu3d_scan::pattern::{BitCode, Codewords, MpsDecoder, PhaseDecoder, Wave};
use serde_json::Value;

const FAMILIES: [&str; 13] = [
    "sinusoid", "triangle", "ramp", "random", "gray", "binary", "xor", "phase", "mps", "hilbert", "alacarte", "rgb",
    "film",
];

fn nelu3d(args: &[&str], dir: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nelu3d"))
        .args(["-q", "patterns"])
        .args(args)
        .current_dir(dir)
        .output()
        .expect("the program starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(args: &[&str], dir: &Path) -> Value {
    let out = nelu3d(&[args, &["--json"]].concat(), dir);
    assert!(out.status.success(), "{args:?}: {}", stderr(&out));
    serde_json::from_slice(&out.stdout).expect("JSON")
}

fn names(value: &Value) -> Vec<String> {
    value.as_array().map_or(Vec::new(), |a| a.iter().map(|v| v.as_str().unwrap().to_owned()).collect())
}

/// One line that names `what`, exit code 1.
fn complaint(args: &[&str], dir: &Path, what: &str) {
    let out = nelu3d(args, dir);
    let text = stderr(&out);
    assert_eq!(out.status.code(), Some(1), "{args:?}: {text}");
    assert!(text.trim_end().lines().count() == 1 && text.contains(what), "{args:?}: {text}");
    assert!(out.stdout.is_empty());
}

fn line_of(dir: &Path, name: &str) -> Vec<f32> {
    let image = read_any(&dir.join(name)).unwrap();
    image.data[..image.width].to_vec()
}

#[test]
fn every_family_works_with_a_size_alone() {
    let dir = tempfile::tempdir().unwrap();
    for family in FAMILIES {
        let about = json(&[family, "--size", "96x12", "-o", family], dir.path());
        let folder = dir.path().join(family);
        let images = names(&about["pattern_set"]["images"]);
        assert!(!images.is_empty() && about["pattern_set"]["name"] == family, "{about}");
        for name in images.iter().map(String::as_str).chain(["white.png", "black.png"]) {
            let raw = decode(&folder.join(name), None).unwrap();
            assert_eq!((raw.width, raw.height), (96, 12), "{family}/{name}");
            assert_eq!(raw.depth(), Depth::U8, "{family}/{name}");
        }
        assert!(read_any(&folder.join("white.png")).unwrap().data.iter().all(|&v| v == 1.0));
        assert!(read_any(&folder.join("black.png")).unwrap().data.iter().all(|&v| v == 0.0));
        // What the folder says of itself is what was said.
        let saved: Value = serde_json::from_slice(&fs::read(folder.join("patterns.json")).unwrap()).unwrap();
        assert_eq!(saved["pattern_set"], about["pattern_set"]);
        assert_eq!(fs::read_dir(&folder).unwrap().count(), images.len() + 3, "{family}");
    }
}

/// The set of three is what took three commands: the same images, for both axes.
#[test]
fn the_recommended_set_is_three_commands_in_one() {
    let dir = tempfile::tempdir().unwrap();
    for (axis, length) in [("x", "320"), ("y", "240")] {
        let about = json(&["recommended", "--size", "320x240", "--axis", axis, "-o", "set"], dir.path());
        assert_eq!(about["pattern_set"]["name"], "mixed3");
        let length: f64 = length.parse().unwrap();
        let px = |n: f64| format!("{}", length / n);
        let parts: [(&str, Vec<String>); 3] = [
            ("sinusoid", vec!["--period".into(), px(40.0), "--steps".into(), "1".into()]),
            ("triangle", vec!["--period".into(), px(3.0)]),
            (
                "random",
                vec!["--min-period".into(), px(16.0), "--max-period".into(), px(2.0), "--seed".into(), "9".into()],
            ),
        ];
        for ((family, options), name) in parts.iter().zip(names(&about["pattern_set"]["images"])) {
            let options: Vec<&str> = options.iter().map(String::as_str).collect();
            json(&[&[family, "--size", "320x240", "--axis", axis, "-o", "one"], &options[..]].concat(), dir.path());
            let [set, one] = ["set", "one"].map(|d| fs::read(dir.path().join(d).join(&name)).unwrap());
            assert!(set == one, "{name} along {axis}");
        }
    }
    for n in ["3", "5", "8"] {
        let about = json(&["recommended", "--size", "640x8", "--images", n, "-o", "n"], dir.path());
        assert_eq!(names(&about["pattern_set"]["images"]).len().to_string(), n);
    }
    assert_eq!(nelu3d(&["recommended", "--size", "640x8", "--images", "4"], dir.path()).status.code(), Some(2));
    complaint(&["recommended", "--size", "60x80", "-o", "tiny"], dir.path(), "`period_px` is 1.5");
}

#[test]
fn the_answer_is_a_part_of_a_rig_toml() {
    let dir = tempfile::tempdir().unwrap();
    let out = nelu3d(&["gray", "--size", "4x4", "--inverse", "-o", "g"], dir.path());
    assert_eq!(
        String::from_utf8(out.stdout).unwrap(),
        "# 6 images of 4 x 4 px in g\n[[pattern_sets]]\nname = \"gray\"\n\
         images = [\"gray_x_00.png\", \"gray_x_01.png\"]\n\
         inverse = [\"gray_x_inv_00.png\", \"gray_x_inv_01.png\"]\n"
    );
}

#[test]
fn images_on_disk_decode_to_their_columns() {
    let dir = tempfile::tempdir().unwrap();
    let n = 300;
    let lines = |family: &str, more: &[&str]| -> Vec<Vec<f32>> {
        let about = json(&[&[family, "--size", "300x4", "-o", family], more].concat(), dir.path());
        names(&about["pattern_set"]["images"]).iter().map(|i| line_of(&dir.path().join(family), i)).collect()
    };
    let pixel = |lines: &[Vec<f32>], u: usize| -> Vec<f32> { lines.iter().map(|l| l[u]).collect() };

    let codes = [("gray", BitCode::Gray), ("binary", BitCode::Binary), ("xor", BitCode::Xor { base_bit: 0 })];
    for (family, code) in codes {
        let lines = lines(family, &[]);
        assert!((0..n).all(|u| code.decode(&pixel(&lines, u), &[], 0.1) == Some(u as u32)), "{family}");
    }
    // Of waves nothing is known but what the images show.
    let fit = |lines: &[Vec<f32>]| -> Vec<Wave> { lines.iter().map(|l| Wave::fit(l).unwrap().wave).collect() };
    let phase = lines("phase", &["--period", "15,40,330", "--steps", "4"]);
    let decoder = PhaseDecoder::new(&snapped(fit(&phase)), n).unwrap();
    for u in 0..n {
        let column = decoder.decode(&pixel(&phase, u), 0.0).unwrap().column;
        assert!((column - u as f32).abs() < 0.05, "{column}, not {u}");
    }
    let mps = lines("mps", &["--frequencies", "4"]);
    let decoder = MpsDecoder::new(&snapped(fit(&mps)), n).unwrap();
    for u in 0..n {
        let column = decoder.decode(&pixel(&mps, u), 0.0).unwrap().column;
        assert!((column - u as f32).abs() < 0.1, "{column}, not {u}");
    }
    let about: Value = serde_json::from_slice(&fs::read(dir.path().join("mps/patterns.json")).unwrap()).unwrap();
    assert_eq!(about["patterns"][0]["periods_px"].as_array().unwrap().len(), 4, "what was chosen is on record");
    let hilbert = lines("hilbert", &["--count", "3"]);
    let words = Codewords::new(3, (0..n).flat_map(|u| pixel(&hilbert, u)).collect());
    assert!((0..n).all(|u| words.nearest(&pixel(&hilbert, u)).unwrap().0 == u));
}

/// Fitted periods that agree to 0.2 % are one: shifts of one wave, fitted to 8-bit images one by one.
fn snapped(mut waves: Vec<Wave>) -> Vec<Wave> {
    for i in 1..waves.len() {
        let near = |w: &&Wave| (w.period_px / waves[i].period_px - 1.0).abs() < 2e-3;
        if let Some(first) = waves[..i].iter().find(near).copied() {
            waves[i].period_px = first.period_px;
        }
    }
    waves
}

#[test]
fn both_axes_bits_and_gamma() {
    let dir = tempfile::tempdir().unwrap();
    let about =
        json(&["ramp", "--size", "65x33", "--axis", "both", "--bits", "16", "--gamma", "2.2", "-o", "r"], dir.path());
    assert_eq!(names(&about["pattern_set"]["images"]), ["ramp_00.png", "ramp_01.png"]);
    let [x, y] = ["ramp_00.png", "ramp_01.png"].map(|name| {
        let path = dir.path().join("r").join(name);
        assert_eq!(decode(&path, None).unwrap().depth(), Depth::U16);
        read_any(&path).unwrap()
    });
    for (u, v) in [(0, 0), (32, 7), (64, 32)] {
        let light = |code: f32| f64::from(code).powf(2.2);
        assert!((light(x.pixel(u, v)[0]) - u as f64 / 64.0).abs() < 1e-3);
        assert!((light(y.pixel(u, v)[0]) - v as f64 / 32.0).abs() < 1e-3);
    }
    let gray = json(&["gray", "--size", "65x33", "--axis", "both", "--inverse", "-o", "g"], dir.path());
    let (images, inverse) = (names(&gray["pattern_set"]["images"]), names(&gray["pattern_set"]["inverse"]));
    assert_eq!((images.len(), inverse.len()), (13, 13));
    assert!(images.contains(&"gray_y_05.png".into()) && inverse.contains(&"gray_x_inv_06.png".into()));
}

#[test]
fn an_earlier_folder_is_replaced_and_no_other() {
    let dir = tempfile::tempdir().unwrap();
    json(&["gray", "--size", "64x4", "-o", "p"], dir.path());
    json(&["ramp", "--size", "64x4", "-o", "p"], dir.path());
    assert!(!dir.path().join("p/gray_x_00.png").exists() && dir.path().join("p/ramp_00.png").exists());
    fs::create_dir(dir.path().join("mine")).unwrap();
    fs::write(dir.path().join("mine/thesis.tex"), "years").unwrap();
    complaint(&["gray", "--size", "64x4", "-o", "mine"], dir.path(), "choose another folder");
    assert_eq!(fs::read_dir(dir.path().join("mine")).unwrap().count(), 1);
}

#[test]
fn wrong_settings_leave_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let wrong: [(&[&str], &str); 8] = [
        (&["gray", "--size", "0x80"], "0 x 80 px"),
        (&["gray", "--size", "80x99999"], "80 x 99999 px"),
        (&["sinusoid", "--size", "64x4", "--period", "1"], "`period_px` is 1"),
        (&["phase", "--size", "64x4", "--steps", "2"], "`steps` is 2"),
        (&["phase", "--size", "64x4", "--period", "20,30", "--steps", "3,3,3"], "`steps`"),
        (&["hilbert", "--size", "1280x4", "--count", "1"], "`count` is 1"),
        (&["alacarte", "--size", "64x4", "--max-frequency", "60"], "`max_frequency` is 60"),
        (&["xor", "--size", "64x4", "--base", "3"], "`base_px` is 3"),
    ];
    for (args, what) in wrong {
        complaint(&[args, &["-o", "out"]].concat(), dir.path(), what);
    }
    // Options of another family, or no options at all, are wrong usage.
    let usage: [&[&str]; 7] = [
        &[],
        &["plaid", "--size", "64x4"],
        &["gray"],
        &["gray", "--size", "64"],
        &["sinusoid", "--size", "64x4", "--inverse"],
        &["gray", "--size", "64x4", "--bits", "12"],
        &["gray", "--size", "64x4", "--gamma", "0"],
    ];
    for args in usage {
        assert_eq!(nelu3d(args, dir.path()).status.code(), Some(2), "{args:?}");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn scores_rank_codes() {
    let dir = tempfile::tempdir().unwrap();
    let astray = |args: &[&str]| -> f64 {
        json(&[args, &["--size", "640x2", "-o", "p"]].concat(), dir.path());
        let score = json(&["score", "p", "--noise", "0.02", "--beyond", "2"], dir.path());
        assert_eq!((score["codes"][0]["columns"].as_u64(), score["codes"][0]["axis"].as_str()), (Some(640), Some("x")));
        score["codes"][0]["zncc"]["beyond"][0].as_f64().unwrap()
    };
    let periodic = astray(&["sinusoid", "--period", "80"]);
    let slow = astray(&["sinusoid", "--period", "650"]);
    let optimized = astray(&["alacarte", "--max-frequency", "8", "--iterations", "400"]);
    assert!(periodic > 0.8 && optimized < 0.5 * slow && slow < periodic, "{periodic}, {slow}, {optimized}");
}

#[test]
fn a_score_sees_both_axes_and_writes_their_pictures() {
    let dir = tempfile::tempdir().unwrap();
    json(&["gray", "--size", "1100x40", "--axis", "both", "--inverse", "-o", "g"], dir.path());
    let score = json(&["score", "g", "--samples", "1", "-o", "m.png"], dir.path());
    let codes = score["codes"].as_array().unwrap();
    assert_eq!(codes.len(), 2);
    assert_eq!(names(&score["left_aside"]).len(), 2 + 17);
    for (code, [columns, side]) in codes.iter().zip([[1100, 550], [40, 40]]) {
        assert_eq!(code["columns"], columns);
        // Two columns differ in one bit at least, and the nearest far ones in just one.
        assert_eq!(code["separations"][0]["euclidean"], 1.0);
        assert_eq!(code["nearest"]["mean_px"], 0.0);
        let picture = decode(&dir.path().join(code["picture"].as_str().unwrap()), None).unwrap();
        assert_eq!((picture.width, picture.height), (side, side));
    }
    let text = String::from_utf8(nelu3d(&["score", "g"], dir.path()).stdout).unwrap();
    assert!(text.contains("1100 columns along x") && text.contains("40 rows along y"), "{text}");
    assert_eq!(score, json(&["score", "g", "--samples", "1", "-o", "m.png"], dir.path()));
}

#[test]
fn folders_that_are_no_code_are_explained() {
    let dir = tempfile::tempdir().unwrap();
    let folder = |name: &str| {
        let path = dir.path().join(name);
        fs::create_dir(&path).unwrap();
        path
    };
    let ramp = |w: usize, h: usize, f: &dyn Fn(usize, usize) -> f32| Image {
        data: (0..w * h).map(|i| f(i % w, i / w)).collect(),
        ..Image::new(w, h, 1)
    };
    complaint(&["score", "nowhere"], dir.path(), "nowhere: cannot be listed");
    folder("empty");
    complaint(&["score", "empty"], dir.path(), "empty: holds no pattern");
    let path = folder("white");
    write_png8(&path.join("white.png"), &ramp(8, 4, &|_, _| 1.0), 0.0, 255.0).unwrap();
    complaint(&["score", "white"], dir.path(), "white.png");
    let path = folder("sizes");
    write_png8(&path.join("a.png"), &ramp(8, 4, &|x, _| x as f32 / 7.0), 0.0, 255.0).unwrap();
    write_png8(&path.join("b.png"), &ramp(9, 4, &|x, _| x as f32 / 8.0), 0.0, 255.0).unwrap();
    complaint(&["score", "sizes"], dir.path(), "b.png: is 9x4 pixels, but sizes/a.png is 8x4");
    let path = folder("dots");
    write_png8(&path.join("dots.png"), &ramp(8, 4, &|x, y| ((x + y) % 2) as f32), 0.0, 255.0).unwrap();
    complaint(&["score", "dots"], dir.path(), "dots.png: changes along x and along y");
    let path = folder("broken");
    fs::write(path.join("a.png"), [0x89, b'P', b'N', b'G', 0, 0]).unwrap();
    complaint(&["score", "broken"], dir.path(), "a.png");
    assert_eq!(nelu3d(&["score", "empty", "--noise", "-1"], dir.path()).status.code(), Some(2));
}
