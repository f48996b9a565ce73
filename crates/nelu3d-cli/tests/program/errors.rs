//! Everything that people's folders, disks and keyboards do to the program: whatever is wrong, it says so in one
//! sentence that names the file and a remedy, ends with exit code 1, and leaves nothing half written.
//!
//! Every test breaks its own copy of a small rig.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use super::common::{RigCopy as Rig, nelu3d, stderr, template};
use nelu3d_scan::Image;
use nelu3d_scan::image::{write_png8, write_png16, write_rgb8};

const W: usize = 160;
const H: usize = 120;
const POSITIONS: usize = 8;
const FIELD: &str = "fields/two.safetensors";

impl Rig {
    /// The rig as it is before it is calibrated.
    fn uncalibrated() -> Self {
        let rig = Self::new();
        fs::remove_dir_all(rig.at("fields")).unwrap();
        rig
    }

    /// Overwrites an image with one value in [0, 1] of full scale.
    fn flat(&self, file: &str, value: f32) {
        let image = Image { data: vec![value; W * H], ..Image::new(W, H, 1) };
        write_png16(&self.at(file), &image, 64.0, 4095.0).unwrap();
    }

    /// Every file and folder, hidden ones too.
    fn files(&self) -> BTreeSet<PathBuf> {
        let mut all = BTreeSet::new();
        list(self.dir.path(), &mut all);
        all
    }

    /// The command fails with one sentence that holds all of `says`, and leaves the folder as it was.
    #[track_caller]
    fn fails(&self, command: &str, rest: &[&str], says: &[&str]) {
        let before = self.files();
        let out = self.run(command, rest);
        one_sentence(&out, says);
        let after = self.files();
        assert_eq!(after, before, "left behind or lost: {:?}", after.symmetric_difference(&before));
    }

    #[track_caller]
    fn calibrate_fails(&self, says: &[&str]) {
        self.fails("calibrate", &[], says);
    }

    #[track_caller]
    fn reconstruct_fails(&self, says: &[&str]) {
        self.fails("reconstruct", &["ball"], says);
    }

    /// `check` fails and says all of this on standard output.
    #[track_caller]
    fn check_finds(&self, says: &[&str]) {
        let out = self.run("check", &[]);
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        assert_eq!(out.status.code(), Some(1), "{text}");
        for part in says {
            assert!(text.contains(part), "`{part}` is not in:\n{text}");
        }
    }
}

#[track_caller]
fn one_sentence(out: &Output, says: &[&str]) {
    // A calibration may warn before it fails for another reason.
    let text: String = stderr(out).lines().filter(|l| !l.starts_with("warning: ")).map(|l| format!("{l}\n")).collect();
    assert_eq!(out.status.code(), Some(1), "{text}");
    assert_eq!(String::from_utf8_lossy(&out.stdout), "", "{text}");
    assert!(!text.contains("panicked"), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    assert!(text.starts_with("nelu3d: "), "{text}");
    // What is wrong, then what to do.
    assert!(text.contains("; ") || text.contains(": run "), "no remedy: {text}");
    for part in says {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    // A path told twice is two messages glued together.
    if let Some(first) = says.first().filter(|s| s.contains('/')) {
        assert_eq!(text.matches(first).count(), 1, "{text}");
    }
}

fn list(dir: &Path, all: &mut BTreeSet<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            list(&path, all);
        }
        all.insert(path);
    }
}

#[test]
fn the_unbroken_rig_works() {
    let rig = Rig::new();
    let out = rig.run("check", &[]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stdout));
    let out = rig.run("reconstruct", &["ball", "--truth", rig.at("scenes/ball/truth").to_str().unwrap()]);
    assert!(out.status.success(), "{}", stderr(&out));
    assert_eq!(stderr(&out), "");
    assert!(rig.at("results/ball-two/result.json").is_file());
    assert!(!rig.files().iter().any(|f| f.to_string_lossy().contains("partial")));
}

/// A trace records every iteration, costs no accuracy, and changes nothing.
#[test]
fn a_trace_watches_without_touching() {
    let rig = Rig::new();
    let truth = rig.at("scenes/ball/truth");
    let plain = rig.at("plain");
    let traced = rig.at("traced");
    let run = |out: &Path, more: &[&str]| {
        let mut args =
            vec!["ball", "--effort", "quick", "--truth", truth.to_str().unwrap(), "-o", out.to_str().unwrap()];
        args.extend(more);
        let done = rig.run("reconstruct", &args);
        assert!(done.status.success(), "{}", stderr(&done));
        let text = fs::read_to_string(out.join("result.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let (a, b) = (run(&plain, &[]), run(&traced, &["--trace"]));
    assert!(a["trace"].is_null());
    assert_eq!(fs::read(plain.join("depth.npy")).unwrap(), fs::read(traced.join("depth.npy")).unwrap());
    let points = b["trace"].as_array().unwrap();
    let stages: Vec<&str> = points.iter().map(|p| p["stage"].as_str().unwrap()).collect();
    let steps = b["method"]["effort"]["steps"].as_u64().unwrap() as usize;
    assert_eq!(stages.len(), steps + 2);
    assert_eq!((stages[0], stages[1], *stages.last().unwrap()), ("decode", "refine", "result"));
    let secs: Vec<f64> = points.iter().map(|p| p["cpu_secs"].as_f64().unwrap()).collect();
    assert!(secs.windows(2).all(|s| s[0] <= s[1]), "{secs:?}");
    // The last point is the result itself.
    let last = points.last().unwrap();
    assert_eq!(last["mae"], b["metrics"]["whole"]["depth_mm"]["mae"]);
    assert_eq!(last["body_median"], b["metrics"]["body"]["depth_mm"]["median"]);
    assert!(last["mae"].as_f64() < points[0]["mae"].as_f64(), "refinement did not help: {points:?}");
}

// Images.

#[test]
fn a_missing_image() {
    let rig = Rig::uncalibrated();
    fs::remove_file(rig.at("calibration/003/sine_00.png")).unwrap();
    fs::remove_file(rig.at("scenes/ball/triangle_00.png")).unwrap();
    rig.calibrate_fails(&["calibration/003/sine_00.png", "there is no such image", "capture it"]);
    rig.check_finds(&["calibration/003/sine_00.png", "scenes/ball/triangle_00.png"]);
    let rig = Rig::new();
    fs::remove_file(rig.at("scenes/ball/triangle_00.png")).unwrap();
    rig.reconstruct_fails(&["scenes/ball/triangle_00.png", "there is no such image", "capture it"]);
}

#[test]
fn a_truncated_image() {
    let rig = Rig::new();
    for file in ["calibration/005/white.png", "scenes/ball/sine_00.png"] {
        let bytes = fs::read(rig.at(file)).unwrap();
        fs::write(rig.at(file), &bytes[..bytes.len() / 2]).unwrap();
    }
    rig.calibrate_fails(&["calibration/005/white.png", "truncated", "capture it again"]);
    rig.reconstruct_fails(&["scenes/ball/sine_00.png", "truncated", "capture it again"]);
    for (bytes, says) in [(&b""[..], "it is empty"), (b"no picture", "neither PNG")] {
        fs::write(rig.at("scenes/ball/sine_00.png"), bytes).unwrap();
        rig.reconstruct_fails(&["scenes/ball/sine_00.png", says]);
    }
}

#[test]
fn an_image_of_another_size() {
    let rig = Rig::new();
    for file in ["calibration/002/triangle_00.png", "scenes/ball/white.png"] {
        write_png16(&rig.at(file), &Image::new(W / 2, H, 1), 64.0, 4095.0).unwrap();
    }
    rig.calibrate_fails(&["calibration/002/triangle_00.png", "80x120", "160x120", "correct the intrinsics"]);
    rig.reconstruct_fails(&["scenes/ball/white.png", "80x120", "160x120", "correct the intrinsics"]);
}

#[test]
fn an_image_of_another_depth() {
    // Eight bits never reach a saturation of 4095.
    let rig = Rig::new();
    for file in ["calibration/002/white.png", "scenes/ball/sine_00.png"] {
        write_png8(&rig.at(file), &Image::new(W, H, 1), 0.0, 255.0).unwrap();
    }
    rig.calibrate_fails(&["calibration/002/white.png", "8-bit", "4095", "save it"]);
    rig.reconstruct_fails(&["scenes/ball/sine_00.png", "8-bit", "4095", "save it"]);

    // Where both depths reach it, the images of a folder still have to agree.
    rig.edit("rig.toml", "saturation = 4095.0", "saturation = 255.0");
    rig.calibrate_fails(&["8-bit", "16-bit", "calibration/002", "capture one folder's images with one setting"]);
    rig.reconstruct_fails(&["8-bit", "16-bit", "scenes/ball", "capture one folder's images with one setting"]);
}

#[test]
fn mixed_channels() {
    let rig = Rig::new();
    for file in ["calibration/006/black.png", "scenes/ball/triangle_00.png"] {
        let colors: Vec<u8> = (0..W * H * 3).map(|i| (i % 251) as u8).collect();
        write_rgb8(&rig.at(file), W, H, &colors).unwrap();
    }
    rig.calibrate_fails(&["calibration/006/black.png", "three channels", "camera.channels"]);
    rig.reconstruct_fails(&["scenes/ball/triangle_00.png", "three channels", "camera.channels"]);
}

#[test]
fn a_black_white_image() {
    let rig = Rig::new();
    rig.flat("scenes/ball/white.png", 0.0);
    rig.reconstruct_fails(&["scenes/ball", "100 % of the pixels are too dark", "expose for longer"]);
    rig.check_finds(&["scenes/ball/white.png", "is not brighter than black"]);
    let rig = Rig::uncalibrated();
    for p in 0..POSITIONS {
        rig.flat(&format!("calibration/{p:03}/white.png"), 0.0);
    }
    rig.calibrate_fails(&["calibration: ", "0 of 8", "000 to 007"]);
}

#[test]
fn everything_clipped() {
    let rig = Rig::new();
    for name in ["white.png", "sine_00.png", "triangle_00.png"] {
        rig.flat(&format!("scenes/ball/{name}"), 1.0);
        // The boards are still found, but none of their pixels can be used.
        for p in 0..POSITIONS {
            if name != "white.png" {
                rig.flat(&format!("calibration/{p:03}/{name}"), 1.0);
            }
        }
    }
    rig.reconstruct_fails(&["scenes/ball", "100 % clipped", "expose for less"]);
    rig.calibrate_fails(&["calibration: ", "clipped", "check exposure"]);
    rig.check_finds(&["scenes/ball/white.png", "calibration/000/sine_00.png", "clipped nearly everywhere"]);
}

// The board.

#[test]
fn no_board_in_any_position() {
    let rig = Rig::uncalibrated();
    for p in 0..POSITIONS {
        rig.flat(&format!("calibration/{p:03}/white.png"), 0.6);
    }
    rig.calibrate_fails(&["calibration: ", "0 of 8", "000 to 007", "at least 3 are needed", "show the whole board"]);
}

#[test]
fn two_usable_positions() {
    let rig = Rig::uncalibrated();
    for p in 2..POSITIONS {
        rig.flat(&format!("calibration/{p:03}/white.png"), 0.6);
    }
    rig.calibrate_fails(&["calibration: ", "2 of 8", "002 to 007", "at least 3 are needed", "show the whole board"]);
    for p in 2..POSITIONS {
        fs::remove_dir_all(rig.at(&format!("calibration/{p:03}"))).unwrap();
    }
    rig.calibrate_fails(&["calibration: ", "2 usable board positions", "at least 3 are needed", "capture more"]);
    fs::remove_dir_all(rig.at("calibration")).unwrap();
    rig.calibrate_fails(&["calibration: ", "no calibration sweep", "one folder per board position"]);
}

#[test]
fn an_unknown_dictionary() {
    let rig = Rig::uncalibrated();
    rig.edit("rig.toml", "DICT_4X4_50", "DICT_9X9_50");
    rig.calibrate_fails(&["rig/rig.toml", "board.dictionary", "DICT_9X9_50", "DICT_4X4_50"]);
    rig.check_finds(&["board.dictionary", "DICT_9X9_50"]);
}

#[test]
fn a_board_that_nobody_can_print() {
    let rig = Rig::uncalibrated();
    rig.edit("rig.toml", "id = 3", "id = 50");
    rig.calibrate_fails(&["rig/rig.toml", "marker 50", "correct"]);
    rig.check_finds(&["rig.toml", "marker 50"]);
}

// Text files.

#[test]
fn a_broken_camera_file() {
    let rig = Rig::new();
    let good = fs::read_to_string(rig.at("camera.json")).unwrap();
    let f = good.find("450.0").expect("the focal length");
    let with = |number: &str| format!("{}{number}{}", &good[..f], &good[f + 5..]);
    let cases = [
        (with("0.0"), "focal length"),
        (with("-450.0"), "focal length"),
        (with("NaN"), "NaN"),
        (with(".nan"), "NaN"),
        (with("null"), "null"),
        (good.replace("\"K\"", "\"J\""), "`K`"),
        (good.replace("\"resx\": 160", "\"resx\": 0"), "resx"),
        (good.replace("\"resx\": 160", "\"resx\": 1e300"), "resx"),
        (good[..good.len() / 2].to_owned(), "not valid"),
        ("[".repeat(100_000), "not valid"),
        ("{\"a\":".repeat(100_000), "not valid"),
        (String::new(), "camera file"),
    ];
    for (text, says) in cases {
        fs::write(rig.at("camera.json"), text).unwrap();
        rig.calibrate_fails(&["rig/camera.json", says]);
        rig.reconstruct_fails(&["rig/camera.json", says]);
        rig.check_finds(&["camera.json", says]);
    }
    fs::write(rig.at("camera.json"), [0xff, 0xfe, 0x00, 0x41]).unwrap();
    rig.calibrate_fails(&["rig/camera.json"]);
    fs::remove_file(rig.at("camera.json")).unwrap();
    rig.calibrate_fails(&["rig/camera.json", "put the calibration there"]);
}

#[test]
fn a_broken_rig_toml() {
    let rig = Rig::new();
    let good = fs::read_to_string(rig.at("rig.toml")).unwrap();
    let cases = [
        (good.replace("black_level", "blacklevel"), "blacklevel"),
        (format!("colour = \"red\"\n{good}"), "colour"),
        (good.replace("format = 1", "format = 2"), "update the program"),
        (good.replace("format = 1", "format = 2\nsomething_newer = 1"), "update the program"),
        (good.replace("format = 1", "format = \"one\""), "line 1"),
        (good.replace("format = 1", "format = 0"), "`format`"),
        (good.replace("[camera]", "[camera"), "line 4"),
        (good.replace("saturation = 4095.0", "saturation = nan"), "camera.saturation"),
        (good.replace("\"mono\"", "\"infrared\""), "infrared"),
        (good[..good.len() / 3].to_owned(), "rig.toml"),
        (String::new(), "format"),
        ("[".repeat(50_000), "line 1"),
    ];
    for (text, says) in cases {
        assert_ne!(text, good);
        fs::write(rig.at("rig.toml"), &text).unwrap();
        rig.calibrate_fails(&["rig/rig.toml", says]);
        rig.reconstruct_fails(&["rig/rig.toml", says]);
        rig.check_finds(&["rig.toml", says]);
    }
    fs::write(rig.at("rig.toml"), [b'n', 0xff, 0xfe, 0]).unwrap();
    rig.calibrate_fails(&["rig/rig.toml", "no text"]);
}

#[test]
fn garbage_for_rig_toml_and_camera_json() {
    let rig = Rig::uncalibrated();
    let mut random = Random(7);
    for file in ["rig.toml", "camera.json"] {
        let good = fs::read(rig.at(file)).unwrap();
        for _ in 0..20 {
            let n = random.below(600);
            let garbage: Vec<u8> = (0..n).map(|_| random.below(256) as u8).collect();
            fs::write(rig.at(file), garbage).unwrap();
            rig.calibrate_fails(&[file]);
        }
        fs::write(rig.at(file), good).unwrap();
    }
}

#[test]
fn check_lists_many_faults_at_once() {
    let rig = Rig::new();
    rig.edit("rig.toml", "DICT_4X4_50", "DICT_9X9_50");
    rig.edit("rig.toml", "\"mono\"", "\"infrared\"");
    rig.edit("camera.json", "450.0", "0.0");
    fs::write(rig.at("projector.json"), "{}").unwrap();
    fs::remove_file(rig.at("calibration/003/sine_00.png")).unwrap();
    fs::write(rig.at("calibration/004/white.png"), b"no picture").unwrap();
    write_png16(&rig.at("scenes/ball/white.png"), &Image::new(W / 2, H, 1), 64.0, 4095.0).unwrap();
    fs::write(rig.at("scenes/ball/truth/depth.npy"), b"no array").unwrap();
    rig.check_finds(&[
        "DICT_9X9_50",
        "infrared",
        "focal length",
        "projector.json",
        "calibration/003/sine_00.png",
        "calibration/004/white.png",
        "scenes/ball/",
        "depth.npy",
    ]);
    let out = rig.run("check", &[]);
    assert!(!stderr(&out).contains("panicked"), "{}", stderr(&out));
}

// Checkpoints.

#[test]
fn no_checkpoint() {
    let rig = Rig::uncalibrated();
    rig.reconstruct_fails(&[FIELD, "there is no color field", "nelu3d calibrate"]);
    fs::create_dir_all(rig.at(FIELD)).unwrap();
    rig.reconstruct_fails(&[FIELD, "nelu3d calibrate"]);
}

#[test]
fn a_checkpoint_of_another_rig_or_set() {
    let rig = Rig::new();
    fs::copy(rig.at(FIELD), rig.at("fields/other.safetensors")).unwrap();
    rig.fails(
        "reconstruct",
        &["ball", "--set", "other"],
        &["fields/other.safetensors", "the pattern set", "sine_00.png", "sine_01.png", "nelu3d calibrate"],
    );
    let good = fs::read_to_string(rig.at("camera.json")).unwrap();
    fs::write(rig.at("camera.json"), good.replace("450.0", "470.0")).unwrap();
    rig.reconstruct_fails(&[FIELD, "the camera", "450.0", "470.0", "nelu3d calibrate"]);
}

#[test]
fn a_truncated_checkpoint() {
    let rig = Rig::new();
    let good = fs::read(rig.at(FIELD)).unwrap();
    for n in [0, 4, 100, good.len() / 2, good.len() - 1] {
        fs::write(rig.at(FIELD), &good[..n]).unwrap();
        rig.reconstruct_fails(&[FIELD, "truncated", "nelu3d calibrate"]);
    }
    // A file of the same size that holds something else.
    fs::write(rig.at(FIELD), vec![0x20; good.len()]).unwrap();
    rig.reconstruct_fails(&[FIELD, "nelu3d calibrate"]);
}

#[test]
fn a_newer_checkpoint() {
    let rig = Rig::new();
    let mut bytes = fs::read(rig.at(FIELD)).unwrap();
    let key = br#"\"format\":"#;
    let at = bytes.windows(key.len()).position(|w| w == key).expect("the format in the description");
    bytes[at + key.len()] = b'9';
    fs::write(rig.at(FIELD), bytes).unwrap();
    rig.reconstruct_fails(&[FIELD, "9", "update nelu3d"]);
}

// Outputs.

#[test]
fn an_output_that_cannot_be_written() {
    // A path under a regular file, and a folder's name: refused whoever asks, root too.
    let rig = Rig::new();
    let under = rig.at("rig.toml").join("out");
    let under = under.to_str().unwrap();
    rig.fails("calibrate", &["-o", under], &["rig.toml/out", "is a file, not a folder"]);
    rig.fails("reconstruct", &["ball", "-o", under], &["rig.toml/out", "is a file, not a folder"]);
    let folder = rig.at("patterns");
    let folder = folder.to_str().unwrap();
    rig.fails("calibrate", &["-o", folder], &["rig/patterns", "a folder has this name"]);
    rig.fails("reconstruct", &["ball", "-o", folder], &["rig/patterns", "not an earlier result"]);
    // This is known before the work, not after it.
    let start = Instant::now();
    rig.fails("calibrate", &["--form", "hash", "-o", under], &["rig.toml/out"]);
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
#[cfg(unix)]
fn a_device_is_not_replaced() {
    let rig = Rig::new();
    let socket = rig.at("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    rig.fails("calibrate", &["-o", socket.to_str().unwrap()], &["rig/socket", "not a file"]);
    assert!(!socket.is_file());
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk() {
    /// A tiny file system, unmounted at the end.
    struct Disk(PathBuf);
    impl Drop for Disk {
        fn drop(&mut self) {
            let _ = Command::new("umount").arg(&self.0).output();
        }
    }
    let rig = Rig::new();
    let dir = tempfile::tempdir().unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "tmpfs"]).arg(dir.path()).output();
    if !mounted.is_ok_and(|m| m.status.success()) {
        eprintln!("SKIPPED: a_full_disk: mounting a small file system takes root");
        return;
    }
    let disk = Disk(dir.path().to_path_buf());
    let on_disk = |name: &str| disk.0.join(name).to_str().unwrap().to_owned();
    let (field, result) = (on_disk("new/field.safetensors"), on_disk("results/ball"));
    rig.fails("calibrate", &["-o", &field], &["new/field.safetensors", "free space"]);
    assert_eq!(fs::read_dir(&disk.0).unwrap().count(), 0);
    rig.fails("reconstruct", &["ball", "-o", &result], &["free space"]);
    assert_eq!(fs::read_dir(&disk.0).unwrap().count(), 0);
    let spec = template().join("rig/simulation.toml");
    let out = nelu3d(&["simulate", "--quiet", spec.to_str().unwrap(), "-o", &on_disk("rig")]);
    one_sentence(&out, &["free space"]);
    assert_eq!(fs::read_dir(&disk.0).unwrap().count(), 0);
}

// Ctrl-C.

/// Starts the program and waits until it says that this stage is done.
#[cfg(unix)]
fn start(args: &[&str], stage: &str) -> (Child, BufReader<std::process::ChildStderr>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_nelu3d"))
        .args(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with(stage) {
        line.clear();
        assert!(lines.read_line(&mut line).unwrap() > 0, "it ended before the stage `{stage}`");
    }
    (child, lines)
}

#[cfg(unix)]
fn interrupt(child: &Child) {
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Waits for the end, which must come soon, and with exit code 1.
#[cfg(unix)]
#[track_caller]
fn stops(mut child: Child, mut lines: BufReader<std::process::ChildStderr>) -> String {
    let start = Instant::now();
    let status = loop {
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None if start.elapsed() > Duration::from_secs(20) => {
                child.kill().unwrap();
                panic!("it went on for 20 s after Ctrl-C");
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let mut text = String::new();
    lines.read_to_string(&mut text).unwrap();
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    text
}

#[test]
#[cfg(unix)]
fn ctrl_c_stops_a_calibration() {
    for form in ["grid", "hash"] {
        let rig = Rig::uncalibrated();
        let before = rig.files();
        let dir = rig.at("");
        // Both forms are in their fit by then, the second for minutes.
        let (child, lines) = start(&["calibrate", dir.to_str().unwrap(), "--form", form], "find the light");
        interrupt(&child);
        let text = stops(child, lines);
        assert!(text.contains("nelu3d: stopped; nothing half written was left behind"), "{text}");
        assert_eq!(rig.files(), before, "{form}");
    }
}

#[test]
#[cfg(unix)]
fn ctrl_c_stops_a_reconstruction() {
    let rig = Rig::new();
    let before = rig.files();
    let dir = rig.at("");
    // Steps for hours.
    let args = ["reconstruct", dir.to_str().unwrap(), "ball", "--steps", "1000000"];
    let (child, lines) = start(&args, "decode the cost volume");
    assert_ne!(rig.files(), before, "the result folder is begun before the work");
    interrupt(&child);
    let text = stops(child, lines);
    assert!(text.contains("nelu3d: stopped; nothing half written was left behind"), "{text}");
    assert_eq!(rig.files(), before);
}

#[test]
#[cfg(unix)]
fn a_second_ctrl_c_leaves_nothing_either() {
    let rig = Rig::new();
    let before = rig.files();
    let dir = rig.at("");
    let (child, lines) = start(&["reconstruct", dir.to_str().unwrap(), "ball", "--steps", "1000000"], "prepare");
    interrupt(&child);
    interrupt(&child);
    stops(child, lines);
    let partial: Vec<_> = rig.files().into_iter().filter(|f| f.to_string_lossy().contains("partial")).collect();
    assert_eq!(partial, Vec::<PathBuf>::new());
    assert!(before.is_subset(&rig.files()));
}

#[test]
fn help_tells_the_exit_codes() {
    let out = nelu3d(&["--help"]);
    let text = String::from_utf8_lossy(&out.stdout).replace('\n', " ");
    assert!(text.contains("1 failed, judged bad or stopped by Ctrl-C"), "{text}");
}

/// A linear congruential generator (Knuth, MMIX): the same garbage every time.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }
}
