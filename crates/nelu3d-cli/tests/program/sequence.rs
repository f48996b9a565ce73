//! `nelu3d sequence` on a thrown ball under color film: what it finds, that a kill at any moment changes nothing, that
//! parts make the whole, and that a bad frame stays its own problem.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use std::time::Duration;

use nelu3d_sim::Spec;
use serde_json::Value;

use super::common::{calibrated, nelu3d, small, stderr};

/// The rig with its color field, made once.
pub(super) fn rig() -> &'static Path {
    static RIG: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &RIG.get_or_init(|| calibrated(&spec())).1
}

/// Five frames of the preset's ball.
fn spec() -> Spec {
    let mut spec = small("film-triton");
    spec.sequences[0].frames = 5;
    spec
}

fn arguments<'a>(sequence: &'a str, output: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let fixed = ["sequence", rig().to_str().unwrap(), sequence, "-o", output.to_str().unwrap(), "--keyframe", "3"];
    [&fixed[..], &["--quiet", "--json"], more].concat()
}

fn run(sequence: &str, output: &Path, more: &[&str]) -> Output {
    nelu3d(&arguments(sequence, output, more))
}

fn answer(out: &Output) -> Value {
    assert!(out.status.success(), "{}", stderr(out));
    serde_json::from_slice(&out.stdout).expect("one JSON value")
}

/// Every frame's depth and surface, byte by byte.
pub(super) fn content(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for i in 0..5 {
        for file in ["depth.npy", "sigma.npy", "mesh.ply"] {
            let name = format!("{i:03}/{file}");
            all.insert(name.clone(), std::fs::read(dir.join(&name)).unwrap_or_else(|e| panic!("{name}: {e}")));
        }
    }
    all
}

/// The uninterrupted run, made once: its folder, and what it answered.
pub(super) fn whole() -> &'static (tempfile::TempDir, Value) {
    static WHOLE: OnceLock<(tempfile::TempDir, Value)> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let dir = tempfile::tempdir().unwrap();
        let answer = answer(&run("ball", &dir.path().join("out"), &["--truth"]));
        (dir, answer)
    })
}

fn number(row: &Value, path: &str) -> f64 {
    row.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path} of {row}"))
}

#[test]
fn a_thrown_ball_is_followed_and_its_flash_is_put_right() {
    let (dir, answer) = whole();
    let rows = answer["table"].as_array().unwrap();
    assert_eq!(rows.len(), 5);
    let off = tempfile::tempdir().unwrap();
    let off = self::answer(&run("ball", &off.path().join("out"), &["--truth", "--motion", "off"]));
    for (i, (row, off)) in rows.iter().zip(off["table"].as_array().unwrap()).enumerate() {
        // Keyframes know nothing; the others begin with the frame before.
        assert_eq!(row.pointer("/start/found_anew").is_some(), i % 3 != 0, "{i}: {}", row["start"]);
        let median = |row: &Value| number(row, "/metrics/body/depth_mm/median");
        assert!(median(row) < 0.5, "{i}: {}", median(row));
        assert!(median(row) < 0.75 * median(off), "{i}: {} with, {} without", median(row), median(off));
        // The pattern is taken half a frame before the flash.
        let time = number(row, "/motion/pattern_time/frames");
        assert!((time + 0.5).abs() < 0.08, "{i}: {time}");
    }
    let out = dir.path().join("out");
    for file in ["sequence.json", "animation.glb", "preview.png", "meshes/0000.ply", "meshes/0004.ply"] {
        assert!(out.join(file).is_file(), "{file}");
    }
}

/// Killed again and again, each time a little later, the work goes on and ends with the same bytes.
#[test]
fn a_kill_at_any_moment_changes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut kills = 0;
    for round in 0u64.. {
        let mut child = Command::new(env!("CARGO_BIN_EXE_nelu3d"))
            .args(arguments("ball", &out, &[]))
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(150 + 370 * round));
        match child.try_wait().unwrap() {
            Some(status) => {
                assert!(status.success());
                break;
            }
            // SIGKILL: no chance to tidy up.
            None => child.kill().unwrap(),
        }
        child.wait().unwrap();
        kills += 1;
        assert!(kills < 60, "it never ends");
    }
    assert!(kills >= 2, "killed {kills} times only");
    assert!(content(&out) == content(&whole().0.path().join("out")), "the interrupted run differs");
    let left: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|n| n.starts_with('.'))
        .collect();
    assert!(left.is_empty(), "left behind: {left:?}");
}

#[test]
fn parts_make_the_whole_in_any_order_and_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let second = answer(&run("ball", &out, &["--shard", "2/2", "--threads", "1"]));
    assert_eq!((second["done"].as_u64(), second["complete"].as_bool()), (Some(2), Some(false)));
    assert!(!out.join("sequence.json").exists(), "not before all frames are there");
    let first = answer(&run("ball", &out, &["--shard", "1/2"]));
    assert_eq!((first["done"].as_u64(), first["complete"].as_bool()), (Some(5), Some(true)));
    assert!(out.join("sequence.json").is_file());
    assert!(content(&out) == content(&whole().0.path().join("out")), "parts differ from the whole");
}

#[test]
fn a_bad_frame_is_reported_and_the_rest_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let (frames, out) = (dir.path().join("frames"), dir.path().join("out"));
    for i in 0..3 {
        let (from, to) = (rig().join(format!("sequences/ball/{i:03}")), frames.join(format!("{i:03}")));
        std::fs::create_dir_all(&to).unwrap();
        for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap).filter(|e| e.path().is_file()) {
            std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
    let broken = frames.join("001/white.png");
    let good = std::fs::read(&broken).unwrap();
    std::fs::write(&broken, &good[..good.len() / 2]).unwrap();
    let failed = run(frames.to_str().unwrap(), &out, &[]);
    assert!(!failed.status.success());
    let message = stderr(&failed);
    assert!(message.contains("1 of 3 frames failed: 001") && message.contains("white.png"), "{message}");
    assert!(out.join("000/result.json").is_file() && out.join("002/result.json").is_file());
    assert!(!out.join("001").exists() && out.join("001.failed.txt").is_file());
    // Mended, only that frame is computed.
    std::fs::write(&broken, &good).unwrap();
    let before = std::fs::metadata(out.join("002/result.json")).unwrap().modified().unwrap();
    let mended = answer(&run(frames.to_str().unwrap(), &out, &[]));
    assert_eq!(mended["done"].as_u64(), Some(3));
    assert!(!out.join("001.failed.txt").exists());
    assert_eq!(std::fs::metadata(out.join("002/result.json")).unwrap().modified().unwrap(), before);
}

#[test]
fn frames_of_other_settings_are_not_mixed() {
    let out = whole().0.path().join("out");
    let e = stderr(&run("ball", &out, &["--motion", "off"]));
    assert!(e.contains("made with other settings (motion)") && e.contains("-o"), "{e}");
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("mine.txt"), "x").unwrap();
    let e = stderr(&run("ball", dir.path(), &[]));
    assert!(e.contains("holds no sequence"), "{e}");
    let e = stderr(&run("no-such", &dir.path().join("out"), &[]));
    assert!(e.contains("no-such") && e.contains("ball"), "{e}");
}

/// The script runs as it is, with the scheduler's variables set by hand.
#[test]
fn the_slurm_script_computes_its_part() {
    let dir = tempfile::tempdir().unwrap();
    let (script, out) = (dir.path().join("job.sh"), dir.path().join("with space/out"));
    let written = answer(&run("ball", &out, &["--slurm", script.to_str().unwrap()]));
    assert_eq!(written["tasks"].as_u64(), Some(2));
    let job = Command::new("sh")
        .arg(&script)
        .current_dir(dir.path())
        .env("SLURM_ARRAY_TASK_ID", "2")
        .env("SLURM_CPUS_PER_TASK", "2")
        .output()
        .unwrap();
    assert!(job.status.success(), "{}", stderr(&job));
    assert!(out.join("003/result.json").is_file() && out.join("004/result.json").is_file());
    assert!(!out.join("000").exists());
}
