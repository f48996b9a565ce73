//! `nelu3d capture` without hardware: rehearsals of virtual rigs, killed and resumed, and the page in a real browser.
//!
//! The browser's test is skipped, loudly, where there is no Chromium; `NELU3D_NEED_BROWSER=1` makes that a failure.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::common::{chromium, nelu3d, small, stderr};
use nelu3d_scan::image::{RawData, decode};

/// All images of a rig's positions and scenes, by their places.
fn images(rig: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for part in ["calibration", "scenes"] {
        let Ok(folders) = std::fs::read_dir(rig.join(part)) else { continue };
        for folder in folders.map(|f| f.unwrap().path()) {
            assert!(!folder.file_name().unwrap().to_string_lossy().starts_with('.'), "{} was left", folder.display());
            for file in std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).filter(|f| f.is_file()) {
                all.insert(file.strip_prefix(rig).unwrap().to_path_buf(), std::fs::read(&file).unwrap());
            }
        }
    }
    all
}

fn folders(rig: &Path) -> usize {
    let Ok(folders) = std::fs::read_dir(rig.join("calibration")) else { return 0 };
    folders.filter(|f| !f.as_ref().unwrap().file_name().to_string_lossy().starts_with('.')).count()
}

fn rehearse(target: &Path, source: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_nelu3d"));
    command.args(["--json", "capture", target.to_str().unwrap(), "--rehearse", source.to_str().unwrap()]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Through a display and a camera that are late and unreliable the rig comes out as it was, bit for bit: also when the
/// capture is killed ten times.
#[test]
fn a_killed_capture_goes_on_and_ends_with_the_same_rig() {
    let mut spec = small("demo");
    let nelu3d_sim::spec::SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("a stage") };
    *positions = 24;
    let (dir, source) = super::common::simulated(&spec);
    let target = dir.path().join("captured");
    let mut kills = 0;
    while kills < 10 {
        let before = folders(&target);
        let mut child = rehearse(&target, &source).spawn().unwrap();
        let begun = Instant::now();
        // Killed somewhere in the middle of the folder after the next.
        while folders(&target) <= before && child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < Duration::from_secs(120), "no folder came");
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(kills * 3));
        assert!(child.try_wait().unwrap().is_none(), "it ended before it could be killed {kills} times");
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
    }
    assert!(folders(&target) < 24, "nothing was left to resume");
    let out = rehearse(&target, &source).output().unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(report["found"].as_u64().unwrap() >= 10, "{report}");
    assert!(report["frames"]["stale"].as_u64().unwrap() + report["frames"]["early"].as_u64().unwrap() > 0, "{report}");
    assert_eq!(images(&source), images(&target));
    let out = nelu3d(&["check", target.to_str().unwrap()]);
    assert!(out.status.success(), "{}", stderr(&out));
    // A capture that is complete has nothing to do.
    let out = rehearse(&target, &source).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((report["found"].as_u64(), report["written"].as_array().unwrap().len()), (Some(24), 0));
}

#[test]
fn what_a_capture_needs_is_said_in_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig");
    let path = rig.to_str().unwrap();
    for (args, what) in [
        (vec!["capture", path, "--webcam"], "--size 1280x800"),
        (vec!["capture", path, "--rehearse", path], "no rig"),
        (vec!["capture", path, "--camera-command", "true", "--size", "640x480"], "{file}"),
        (vec!["capture", path, "--watch", "/nowhere", "--patterns", "/nowhere"], "patterns.json"),
    ] {
        let out = nelu3d(&[&["-q"], args.as_slice()].concat());
        let text = stderr(&out);
        assert_eq!(out.status.code(), Some(1), "{args:?}: {text}");
        assert!(text.trim_end().lines().count() == 1 && text.contains(what), "{args:?}: {text}");
        let _ = std::fs::remove_dir_all(&rig);
    }
    let out = nelu3d(&["capture", path, "--webcam", "--watch", "x"]);
    assert_eq!(out.status.code(), Some(2));
}

/// A process that ends with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The page in a real browser shows every pattern pixel for pixel: it sends back what is on its canvas as frames, and
/// the capture, which knows nothing of that, ends with the patterns themselves.
#[test]
fn the_page_shows_patterns_one_to_one() {
    let Some(chromium) = chromium("no page showed patterns") else { return };
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig");
    let mut capture = Command::new(env!("CARGO_BIN_EXE_nelu3d"));
    capture.args(["capture", rig.to_str().unwrap(), "--webcam", "--size", "320x200", "--images", "5"]);
    capture.args(["--scene", "mirror"]).stderr(Stdio::piped()).stdout(Stdio::piped());
    let mut capture = Ends(capture.spawn().unwrap());
    let mut lines = BufReader::new(capture.0.stderr.take().unwrap()).lines().map(Result::unwrap);
    let address = lines.by_ref().find_map(|l| Some(l.split_once("http://")?.1.split(' ').next()?.to_owned()));
    let address = format!("http://{}", address.expect("the capture says where its page is"));
    let rest = std::thread::spawn(move || lines.collect::<Vec<_>>().join("\n"));
    let mut browser = Command::new(chromium);
    browser.args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"]);
    browser.args(["--disable-background-networking", "--disable-component-update", "--window-size=320,200"]);
    browser.args(["--disable-background-timer-throttling", "--disable-renderer-backgrounding", "--hide-scrollbars"]);
    browser.args(["--remote-debugging-port=0", "--force-color-profile=srgb"]);
    browser.arg(format!("--user-data-dir={}", dir.path().join("profile").display())).arg(address + "screen#mirror");
    let browser = Ends(browser.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = capture.0.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < Duration::from_secs(180), "the capture did not end");
        std::thread::sleep(Duration::from_millis(20));
    };
    drop(browser);
    let said = rest.join().unwrap();
    assert!(status.success(), "{said}");
    let mut n = 0;
    for file in std::fs::read_dir(rig.join("patterns")).unwrap().map(|f| f.unwrap().path()) {
        let shown = decode(&file, None).unwrap();
        let seen = decode(&rig.join("scenes/mirror").join(file.file_name().unwrap()), None).unwrap();
        let (RawData::U8(shown), RawData::U8(seen)) = (shown.data, seen.data) else { panic!("8 bits") };
        let gray: Vec<u8> = shown.iter().flat_map(|v| [*v; 3]).collect();
        assert!(gray == seen, "{} was not shown as it is", file.display());
        n += 1;
    }
    assert_eq!(n, 7);
}

/// Whatever is plugged in here, it does not have this serial number; and no rig is made that nobody can fill.
#[cfg(feature = "usb3")]
#[test]
fn a_usb_camera_that_is_not_there_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig");
    let capture = |options: &[&str]| {
        let all = [&["capture", rig.to_str().unwrap(), "--size", "320x200"], options].concat();
        let out = nelu3d(&all);
        assert!(!out.status.success() && !rig.exists());
        stderr(&out)
    };
    let missing = capture(&["--usb3", "no such serial number", "--exposure-us", "8000"]);
    assert!(
        missing.starts_with("nelu3d: USB: ") && missing.contains("; ") && missing.lines().count() == 1,
        "{missing}"
    );
    // They are a driven camera's: other cameras are set in programs of their own.
    for options in [["--exposure-us", "8000"], ["--gain", "2"]] {
        let refused = capture(&[&["--webcam"], &options[..]].concat());
        assert!(refused.contains("--usb3 <SERIAL|auto>"), "{refused}");
    }
}

/// The tutorial's commands without hardware, as they stand there.
#[test]
fn the_tutorial_can_be_followed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("docs/first-scan.md")).unwrap();
    let commands = text.split("```sh\n").nth(1).unwrap().split("```").next().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let mut n = 0;
    for line in commands.lines() {
        let args: Vec<&str> = line.strip_prefix("nelu3d ").expect("a command").split(' ').collect();
        let out = Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(&args).current_dir(dir.path()).output().unwrap();
        assert!(out.status.success(), "{line}: {}", stderr(&out));
        n += 1;
    }
    assert_eq!(n, 5);
    let (virtual_rig, rig) = (dir.path().join("virtual"), dir.path().join("my-rig"));
    let pictures = |rig: &Path| images(rig).into_iter().filter(|(p, _)| p.extension().is_some_and(|e| e == "png"));
    assert!(pictures(&virtual_rig).eq(pictures(&rig)));
    assert!(rig.join("results/vase-mixed3/mesh.ply").is_file());
}
