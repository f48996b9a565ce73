//! The program as a person or a script meets it: exit codes, where things are printed, one sentence an error.

use std::path::Path;
use std::process::{Command, Output};

fn nelu3d(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).output().expect("the program starts")
}

fn code(output: &Output) -> i32 {
    output.status.code().expect("the program ends by itself")
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("text")
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("text")
}

/// One line, from the program, that names `what` and says what to do.
fn assert_one_sentence(output: &Output, what: &str) {
    assert_eq!(code(output), 1, "{}", stderr(output));
    assert_eq!(stdout(output), "");
    let text = stderr(output);
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    assert!(text.starts_with("nelu3d: ") && text.contains(what), "{text}");
}

#[test]
fn help_lists_the_commands() {
    let out = nelu3d(&["--help"]);
    assert_eq!(code(&out), 0);
    const COMMANDS: &[&str] = &[
        "demo",
        "simulate",
        "board",
        "camera",
        "patterns",
        "import",
        "check",
        "projector",
        "calibrate",
        "reconstruct",
        "decode",
        "table",
        "evaluate",
        "bench",
        "devices",
    ];
    for command in COMMANDS {
        assert!(stdout(&out).contains(&format!("\n  {command} ")), "{command}");
        let help = nelu3d(&[command, "--help"]);
        assert_eq!(code(&help), 0, "{command}");
        assert!(stdout(&help).contains("Usage: nelu3d"), "{command}");
    }
    let version = nelu3d(&["--version"]);
    assert_eq!(stdout(&version).trim(), format!("nelu3d {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn devices_are_listed_and_one_that_is_not_there_is_named() {
    let out = nelu3d(&["devices", "--json"]);
    assert_eq!(code(&out), 0);
    let answer: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(answer["gpus"].is_array() && answer["auto"].is_string(), "{answer}");
    let text = stdout(&nelu3d(&["devices"]));
    assert!(text.contains("threads") && text.contains("--device auto takes"), "{text}");
    let out = nelu3d(&["bench", "--device", "gpu:999"]);
    // A driver may have put in a word of its own.
    let said = stderr(&out);
    assert!(code(&out) == 1 && said.contains("gpu:999") && said.contains("--device cpu"), "{said}");
    let out = nelu3d(&["demo", "--device", "cuda"]);
    assert!(code(&out) == 2 && stderr(&out).contains("nelu3d devices"), "{}", stderr(&out));
}

#[test]
fn wrong_usage_is_2() {
    let wrong: [&[&str]; 13] = [
        &[],
        &["fly"],
        &["check"],
        &["check", "a", "b"],
        &["reconstruct", "rig"],
        &["reconstruct", "rig", "scene", "--trace"],
        &["evaluate", "result"],
        &["evaluate", "result", "--truth", "a", "--against", "b"],
        &["check", "rig", "--threads", "0"],
        &["bench", "--seconds", "much"],
        &["import", "frames", "rig"],
        &["import", "frames", "rig", "--scene", "a", "--calibration"],
        &["import", "frames", "rig", "--scene", "a", "--channels", "rgbw"],
    ];
    for args in wrong {
        let out = nelu3d(args);
        assert_eq!(code(&out), 2, "{args:?}: {}", stderr(&out));
        assert_eq!(stdout(&out), "", "{args:?}");
    }
}

#[test]
fn bench_says_how_close_to_the_ceiling_a_kernel_is() {
    let out = nelu3d(&["bench", "compositing", "--seconds", "0", "--json", "--quiet"]);
    assert_eq!(code(&out), 0, "{}", stderr(&out));
    let report: serde_json::Value = serde_json::from_str(&stdout(&out)).unwrap();
    assert!(report["machine"]["flops_per_sec"].as_f64().unwrap() > 1e8);
    assert_eq!(report["kernels"].as_array().unwrap().len(), 1);
    assert!(report["kernels"][0]["share_of_ceiling"].as_f64().unwrap() > 0.0);
    assert_one_sentence(&nelu3d(&["bench", "no-such-kernel", "--quiet"]), "no-such-kernel");
}

#[test]
fn a_missing_rig_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let missing = dir.path().join("no-such-rig");
    let rig = missing.to_str().unwrap();
    let commands: [&[&str]; 3] =
        [&["calibrate", rig], &["reconstruct", rig, "scene"], &["evaluate", rig, "--truth", rig]];
    for args in commands {
        assert_one_sentence(&nelu3d(args), "no-such-rig");
        assert!(!missing.exists(), "{args:?} left something behind");
    }
    let out = nelu3d(&["check", rig]);
    assert_eq!(code(&out), 1);
    assert!(stdout(&out).contains("no-such-rig"), "{}", stdout(&out));
}

#[test]
fn an_unknown_preset_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("rig");
    assert_one_sentence(&nelu3d(&["simulate", "no-such-preset", "-o", target.to_str().unwrap()]), "no-such-preset");
    assert!(!target.exists());
}

#[test]
fn demo_leaves_other_peoples_folders_alone() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("thesis.tex"), "years").unwrap();
    assert_one_sentence(&nelu3d(&["demo", "-o", dir.path().to_str().unwrap()]), "choose a new one");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

/// A rig with a camera, one pattern set and a sweep of three positions, of 16 × 12 gray images.
fn small_rig(root: &Path) {
    let rig = "format = 1\nname = \"small\"\n\
        [camera]\nintrinsics = \"camera.json\"\nchannels = \"mono\"\nblack_level = 0\nsaturation = 255\n\
        [images]\nwhite = \"white.png\"\nblack = \"black.png\"\n\
        [[pattern_sets]]\nname = \"two\"\nimages = [\"a.png\", \"b.png\"]\n\
        [board]\nkind = \"chessboard\"\ncolumns = 7\nrows = 5\nsquare_mm = 20.0\n";
    std::fs::write(root.join("rig.toml"), rig).unwrap();
    let camera = r#"{"resx": 16, "resy": 12, "K": [[20, 0, 8], [0, 20, 6], [0, 0, 1]], "dist_coeffs": []}"#;
    std::fs::write(root.join("camera.json"), camera).unwrap();
    for folder in ["calibration/0", "calibration/1", "calibration/2", "scenes/cup"] {
        let dir = root.join(folder);
        std::fs::create_dir_all(&dir).unwrap();
        for (name, value) in [("white.png", 200), ("black.png", 5), ("a.png", 90), ("b.png", 120)] {
            nelu3d_scan::image::write_gray8(&dir.join(name), 16, 12, &[value; 16 * 12]).unwrap();
        }
    }
}

#[test]
fn check_lists_everything_that_is_wrong() {
    let dir = tempfile::tempdir().unwrap();
    small_rig(dir.path());
    let rig = dir.path().to_str().unwrap();
    std::fs::remove_file(dir.path().join("calibration/1/b.png")).unwrap();
    std::fs::write(dir.path().join("calibration/2/a.png"), b"not a picture").unwrap();
    nelu3d_scan::image::write_gray8(&dir.path().join("scenes/cup/white.png"), 8, 8, &[1; 64]).unwrap();

    let out = nelu3d(&["check", rig]);
    assert_eq!(code(&out), 1, "{}", stderr(&out));
    for file in ["b.png", "a.png", "white.png"] {
        assert!(stdout(&out).contains(file), "{file} is not in: {}", stdout(&out));
    }

    let out = nelu3d(&["check", rig, "--json"]);
    assert_eq!(code(&out), 1);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).expect("one JSON value");
    assert_eq!(json["ok"], false);
    assert!(json["findings"].as_array().unwrap().len() >= 3, "{json}");
}
