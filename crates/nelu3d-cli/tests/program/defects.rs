//! What once broke the program: odd paths, files without an end, names that lead out of the rig, signals, killed runs,
//! absurd numbers. Whatever it is, the program ends soon, in one sentence that names the user's file and a remedy.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use super::common::{RigCopy as Rig, nelu3d, small, stderr, template};

/// The rig's scene; its first pattern set is `two`.
const SCENE: &str = "ball";

/// Longest time that a refusal may take.
const SOON: Duration = Duration::from_secs(20);

impl Rig {
    fn field(&self) -> PathBuf {
        self.at("fields/two.safetensors")
    }

    fn scene_file(&self, file: &str) -> PathBuf {
        self.at(&format!("scenes/{SCENE}/{file}"))
    }

    /// Replaces a line of a file, which begins so.
    fn edit_line(&self, file: &str, beginning: &str, line: &str) {
        let text = fs::read_to_string(self.at(file)).unwrap();
        let old: Vec<&str> = text.lines().filter(|l| l.trim_start().starts_with(beginning)).collect();
        assert!(!old.is_empty(), "no `{beginning}` in {text}");
        fs::write(self.at(file), text.replacen(old[0], line, 1)).unwrap();
    }

    /// Runs a command with the arguments after the rig, which must not take long.
    fn run_soon(&self, command: &str, rest: &[&str]) -> Output {
        soon(|| self.run(command, rest))
    }

    fn reconstruct(&self, rest: &[&str]) -> Output {
        self.run_soon("reconstruct", &[&[SCENE], rest].concat())
    }

    /// Temporary files and folders that are left somewhere.
    fn left(&self) -> Vec<PathBuf> {
        let mut all = Vec::new();
        list(self.dir.path(), &mut all);
        all.retain(|p| {
            p.file_name().unwrap().to_string_lossy().contains(".partial") || p.to_string_lossy().contains(".old-")
        });
        all
    }
}

fn list(dir: &Path, all: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            list(&path, all);
        }
        all.push(path);
    }
}

fn soon<T>(run: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let answer = run();
    assert!(start.elapsed() < SOON, "it took {:?}", start.elapsed());
    answer
}

/// The program failed with one sentence that holds all of `says`.
#[track_caller]
fn one_sentence(out: &Output, says: &[&str]) {
    let text: String = stderr(out).lines().filter(|l| !l.starts_with("warning: ")).map(|l| format!("{l}\n")).collect();
    assert_eq!(out.status.code(), Some(1), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    assert!(text.starts_with("nelu3d: ") && text.contains("; "), "no remedy: {text}");
    for part in says {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

/// `check` fails and says all of this on standard output.
#[track_caller]
fn check_finds(rig: &Rig, says: &[&str]) {
    let out = rig.run_soon("check", &[]);
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(out.status.code(), Some(1), "{text}{}", stderr(&out));
    for part in says {
        assert!(text.contains(part), "`{part}` is not in:\n{text}");
    }
}

// (a) Paths.

/// Every command answers in JSON, or says in a sentence what is wrong, in a folder whose name is no UTF-8.
#[test]
#[cfg(unix)]
fn paths_that_are_no_text() {
    use std::ffi::{OsStr, OsString};
    use std::os::unix::ffi::OsStrExt;
    let rig = Rig::new();
    let home = rig.dir.path().join(OsStr::from_bytes(b"bad\xff"));
    fs::create_dir(&home).unwrap();
    fs::rename(rig.dir.path().join("rig"), home.join("rig")).unwrap();
    let spec_file = home.join("spec.toml");
    fs::copy(home.join("rig/simulation.toml"), &spec_file).unwrap();
    // `.` stands for that folder.
    let commands = [
        "check ./rig".to_owned(),
        "calibrate ./rig".into(),
        format!("reconstruct ./rig {SCENE} --effort quick"),
        format!("evaluate ./rig/results/{SCENE}-two --truth ./rig/scenes/{SCENE}/truth"),
        format!("evaluate ./rig/results/{SCENE}-two --against ./rig/results/{SCENE}-two"),
        format!("evaluate ./rig/results/{SCENE}-two --cad ./rig/scenes/{SCENE}/truth/mesh.ply -o ./cad"),
        format!("decode ./rig {SCENE} --method lookup3d -o ./decoded"),
        "table export ./rig -o ./table.npy".into(),
        "table info ./table.npy".into(),
        "projector ./rig --force".into(),
        "patterns gray --size 64x48 -o ./patterns".into(),
        "patterns score ./patterns".into(),
        "simulate ./spec.toml -o ./simulated".into(),
        format!("sequence ./rig {SCENE}"),
        format!("import ./rig/scenes/{SCENE} ./rig --scene new --order white --last 1"),
        "experiment stage --quick -o ./studies".into(),
        "demo -o ./rig".into(),
    ];
    let mut answered = 0;
    for command in commands {
        let words = command.split(' ').map(|word| match word.strip_prefix("./") {
            Some(rest) => home.join(rest).into_os_string(),
            None => OsString::from(word),
        });
        let out = Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(words).args(["--json", "--quiet"]).output().unwrap();
        let text = stderr(&out);
        assert!(!text.contains("panicked"), "{command}: {text}");
        match out.status.code() {
            Some(0) => {
                answered += 1;
                let answer: Result<serde_json::Value, _> = serde_json::from_slice(&out.stdout);
                assert!(answer.is_ok_and(|a| !a.is_null()), "{command}: no JSON");
            }
            Some(2) => assert!(text.contains("invalid UTF-8"), "{command}: {text}"),
            Some(1) => assert!(text.contains("nelu3d: ") || !out.stdout.is_empty(), "{command}: {text}"),
            other => panic!("{command}: {other:?}: {text}"),
        }
    }
    assert!(answered >= 12, "only {answered} commands worked there");
}

// (d), (e) Files without an end.

#[test]
#[cfg(unix)]
fn pipes_and_devices_for_images() {
    let rig = Rig::new();
    let file = rig.scene_file("white.png");
    fs::remove_file(&file).unwrap();
    assert!(Command::new("mkfifo").arg(&file).status().unwrap().success());
    check_finds(&rig, &["white.png: cannot be read: it is a pipe, a socket or a device; give a regular file"]);
    one_sentence(&rig.reconstruct(&[]), &["white.png: cannot be read: it is a pipe", "give a regular file"]);
    fs::remove_file(&file).unwrap();
    std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
    check_finds(&rig, &["white.png: cannot be read: it is a pipe, a socket or a device"]);
    one_sentence(&rig.reconstruct(&[]), &["white.png: cannot be read: it is a pipe"]);
    fs::remove_file(&file).unwrap();
    fs::create_dir(&file).unwrap();
    one_sentence(&rig.reconstruct(&[]), &["white.png: cannot be read: it is a folder; give a file"]);
    rig.edit("rig.toml", "white = \"white.png\"", "white = \"/dev/zero\"");
    check_finds(&rig, &["`images.white` is \"/dev/zero\"; give the name of a file that lies in every"]);
    one_sentence(&rig.run_soon("calibrate", &[]), &["rig.toml", "`images.white` is \"/dev/zero\""]);
}

// (f) Names that lead out of the rig.

#[test]
fn names_that_lead_out_of_the_rig() {
    let rig = Rig::new();
    rig.edit_line("rig.toml", "name = \"two\"", "name = \"../../escaped\"");
    one_sentence(&rig.run_soon("calibrate", &[]), &["rig.toml", "`pattern_sets.name` is \"../../escaped\"", "no path"]);
    check_finds(&rig, &["`pattern_sets.name` is \"../../escaped\""]);
    assert!(!rig.dir.path().join("escaped.safetensors").exists());
    let rig = Rig::new();
    let (frames, root) = (rig.scene_file(""), rig.at(""));
    let out = nelu3d(&[
        "import",
        frames.to_str().unwrap(),
        root.to_str().unwrap(),
        "--scene",
        "../../escaped",
        "--order",
        "white",
        "--last",
        "1",
        "--quiet",
    ]);
    one_sentence(&out, &["`../../escaped` is no name of a folder"]);
}

// (g), (h) Signals, and runs that are killed.

/// Starts a reconstruction that would take hours, and waits until its folder is begun.
#[cfg(unix)]
fn endless(rig: &Rig) -> std::process::Child {
    let root = rig.at("");
    let child = Command::new(env!("CARGO_BIN_EXE_nelu3d"))
        .args(["reconstruct", root.to_str().unwrap(), SCENE, "--steps", "1000000", "--quiet"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    soon(|| {
        while rig.left().is_empty() {
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    child
}

#[cfg(unix)]
fn send(child: &std::process::Child, signal: &str) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

#[test]
#[cfg(unix)]
fn the_signals_of_schedulers_and_terminals() {
    for (signal, code) in [("-TERM", 143), ("-HUP", 129)] {
        if signal == "-HUP" && is_hangup_ignored() {
            eprintln!("SKIPPED: SIGHUP, which these tests were started to ignore");
            continue;
        }
        let rig = Rig::new();
        let child = endless(&rig);
        send(&child, signal);
        let out = soon(|| child.wait_with_output().unwrap());
        assert_eq!(out.status.code(), Some(code), "{signal}: {}", stderr(&out));
        assert!(stderr(&out).contains("nelu3d: stopped; nothing half written was left behind"), "{}", stderr(&out));
        assert_eq!(rig.left(), Vec::<PathBuf>::new(), "{signal}");
        assert!(!rig.at("results").exists(), "{signal}");
    }
}

/// A study that is asked to end asks the command that it is running, too.
#[test]
#[cfg(target_os = "linux")]
fn a_study_ends_with_its_command() {
    let dir = tempfile::tempdir().unwrap();
    let study = Command::new(env!("CARGO_BIN_EXE_nelu3d"))
        .args(["experiment", "stage", "--quick", "--quiet", "-o", dir.path().to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let command = soon(|| {
        loop {
            if let Some(id) = child_of(study.id()) {
                return id;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    send(&study, "-TERM");
    let out = soon(|| study.wait_with_output().unwrap());
    assert_eq!(out.status.code(), Some(143), "{}", stderr(&out));
    assert!(!Path::new(&format!("/proc/{command}")).exists(), "its command goes on");
    let mut left = Vec::new();
    list(dir.path(), &mut left);
    left.retain(|p| p.to_string_lossy().contains(".partial"));
    assert_eq!(left, Vec::<PathBuf>::new());
}

/// Returns a process that this one has started.
#[cfg(target_os = "linux")]
fn child_of(parent: u32) -> Option<u32> {
    fs::read_dir("/proc").unwrap().flatten().find_map(|entry| {
        let id: u32 = entry.file_name().to_str()?.parse().ok()?;
        let status = fs::read_to_string(entry.path().join("stat")).ok()?;
        // The name may hold anything; what follows it is state and parent.
        let of = status.rsplit_once(") ")?.1.split(' ').nth(1)?;
        (of.parse() == Ok(parent)).then_some(id)
    })
}

/// A terminal that has gone takes standard error along, which is no reason to panic.
#[test]
#[cfg(target_os = "linux")]
fn standard_error_that_has_gone() {
    let rig = Rig::new();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let root = rig.at("");
    let out =
        Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(["calibrate", root.to_str().unwrap()]).stderr(full).status();
    assert_eq!(out.unwrap().code(), Some(0));
}

#[cfg(unix)]
fn is_hangup_ignored() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:")).unwrap_or("0");
    u64::from_str_radix(mask.trim(), 16).unwrap_or(0) & 1 == 1
}

#[test]
#[cfg(target_os = "linux")]
fn what_a_killed_run_left_goes_with_the_next() {
    let rig = Rig::new();
    assert!(rig.reconstruct(&["--effort", "quick"]).status.success());
    let mut child = endless(&rig);
    send(&child, "-KILL");
    child.wait().unwrap();
    assert_eq!(rig.left().len(), 1, "the folder of the killed run");
    // A second one, which is at work, keeps its own.
    let running = endless_beside(&rig);
    let out = rig.reconstruct(&["--effort", "quick"]);
    assert!(out.status.success(), "{}", stderr(&out));
    assert_eq!(rig.left().len(), 1, "{:?}", rig.left());
    send(&running, "-TERM");
    assert_eq!(soon(|| running.wait_with_output().unwrap()).status.code(), Some(143));
    assert_eq!(rig.left(), Vec::<PathBuf>::new());
    assert!(rig.at("results/ball-two/result.json").is_file());
}

/// As [`endless`], where a folder of a killed run lies already; that one is gone then.
#[cfg(target_os = "linux")]
fn endless_beside(rig: &Rig) -> std::process::Child {
    let before = rig.left();
    let root = rig.at("");
    let child = Command::new(env!("CARGO_BIN_EXE_nelu3d"))
        .args(["reconstruct", root.to_str().unwrap(), SCENE, "--steps", "1000000", "--quiet"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    soon(|| {
        while rig.left() == before || rig.left().is_empty() {
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    child
}

// (i), (j), (n) Absurd numbers, and rigs that would fail later.

#[test]
fn numbers_that_no_result_has() {
    let rig = Rig::new();
    assert!(rig.reconstruct(&["--effort", "quick"]).status.success());
    let result = rig.at("results/ball-two");
    let cad = rig.scene_file("truth/mesh.ply");
    let out =
        nelu3d(&["evaluate", result.to_str().unwrap(), "--cad", cad.to_str().unwrap(), "--within", "1e-9", "--quiet"]);
    assert!(!stderr(&out).contains("panicked") && matches!(out.status.code(), Some(0 | 1)), "{}", stderr(&out));
    let out = rig.run_soon("check", &["--threads", "1000000"]);
    assert_eq!(out.status.code(), Some(2));
    let text = stderr(&out);
    assert!(text.contains("--threads <N>': give a number from 1 to 1024"), "{text}");
    assert!(rig.run_soon("check", &["--threads", "1"]).status.success());
}

#[test]
fn rigs_that_would_fail_later() {
    let focal = |rig: &Rig, f: &str| {
        let text = fs::read_to_string(rig.at("camera.json")).unwrap();
        let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
        json["K"][0][0] = serde_json::from_str(f).unwrap();
        fs::write(rig.at("camera.json"), json.to_string()).unwrap();
    };
    for f in ["1.0", "1e300"] {
        let rig = Rig::new();
        focal(&rig, f);
        let says = format!("has the focal length fx = {f} px, for images of up to 160 px; give it in pixels");
        check_finds(&rig, &["camera.json", &says]);
        one_sentence(&rig.run_soon("calibrate", &[]), &["camera.json", &says]);
    }
    let image = "sine_00.png";
    let images = |to: &str| {
        let rig = Rig::new();
        rig.edit_line("rig.toml", "images = [", &format!("images = [{to}]"));
        rig
    };
    check_finds(
        &images("\"white.png\""),
        &["rig.toml", "lists \"white.png\", which is the light at its maximum or off"],
    );
    check_finds(&images(&format!("\"{image}\", \"{image}\"")), &["rig.toml", "twice; list each image once"]);
    let rig = images(&format!("\"{image}\""));
    rig.edit("rig.toml", "white = \"white.png\"", &format!("white = \"{image}\""));
    check_finds(&rig, &["rig.toml", "which is the light at its maximum or off, not a pattern"]);
}

// (k) Color fields that were changed.

#[test]
fn color_fields_that_a_disk_changed() {
    let rig = Rig::new();
    let good = fs::read(rig.field()).unwrap();
    let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    for at in [header + (good.len() - header) / 3, good.len() - 1] {
        let mut bad = good.clone();
        bad[at] ^= 0x40;
        fs::write(rig.field(), &bad).unwrap();
        let out = rig.reconstruct(&[]);
        one_sentence(
            &out,
            &["is no readable color field (it is not as it was written: its SHA-256 differs)", "calibrate"],
        );
    }
}

// (l), (m) Specifications.

const STUDY: &str = "title = 't'\n[rigs.r]\npreset = 'demo'\n[[cases]]\nlabel = 'c'\nrig = 'r'\nscene = 's'\n\
                     [[methods]]\nlabel = 'm'\nrun = 'reconstruct'\n[[columns]]\nlabel = 'l'\n\
                     value = 'result.metrics.whole.depth_mm.mae'\n";

#[test]
fn studies_are_checked_before_they_run() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("study.toml");
    let output = dir.path().join("out");
    for (from, to, says) in [
        ("whole", "hole", "column `l`: `result.metrics.hole.depth_mm.mae` is no value: `result.metrics` has no `hole`"),
        ("run = 'reconstruct'", "run = 'reconstruct'\nseeds = 0", "method `m`: `seeds` is 0, so it would never run"),
    ] {
        fs::write(&file, STUDY.replace(from, to)).unwrap();
        let out = nelu3d(&["experiment", file.to_str().unwrap(), "-o", output.to_str().unwrap(), "--quiet"]);
        one_sentence(&out, &["study.toml", says]);
        assert!(!output.exists());
    }
}

#[test]
fn unknown_keys_of_a_material() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("spec.toml");
    let good = fs::read_to_string(template().join("rig/simulation.toml")).unwrap();
    let line = good.lines().position(|l| l.contains("[scenes.objects.material]") || l.contains("material =")).unwrap();
    let mut lines: Vec<String> = good.lines().map(str::to_owned).collect();
    if lines[line].contains("material =") {
        lines[line] = "material = { kind = \"lambert\", roughness = 0.1 }".into();
    } else {
        lines.insert(line + 1, "roughness = 0.1".into());
    }
    fs::write(&file, lines.join("\n")).unwrap();
    let output = dir.path().join("rig");
    let out = nelu3d(&["simulate", file.to_str().unwrap(), "-o", output.to_str().unwrap(), "--quiet"]);
    one_sentence(&out, &["spec.toml", "unknown field `roughness`"]);
    assert!(!output.exists());
}

// Messages.

#[test]
fn what_differs_between_field_and_rig_is_shown() {
    let rig = Rig::new();
    let text = fs::read_to_string(rig.at("camera.json")).unwrap();
    let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let fx = json["K"][0][0].as_f64().unwrap();
    json["K"][0][0] = (fx + 1e-5).into();
    fs::write(rig.at("camera.json"), json.to_string()).unwrap();
    let (theirs, ours) = (format!("fx = {fx:?}, but the rig has"), format!("fx = {:?}: calibrate", fx + 1e-5));
    one_sentence(&rig.reconstruct(&[]), &["made for the camera 160 × 120 px", &theirs, &ours]);
}

#[test]
fn a_board_outside_of_the_image_is_no_matter_of_exposure() {
    let rig = Rig::new();
    rig.edit_line("rig.toml", "extent_mm = [", "extent_mm = [900, 900, 950, 950]");
    let says = ["rig.toml", "`board.extent_mm` is [900.0, 900.0, 950.0, 950.0], far beside the print"];
    one_sentence(&rig.run_soon("calibrate", &[]), &says);
    check_finds(&rig, &says);
    // As far beside it as a plate may reach, but not in view.
    let rig = Rig::new();
    rig.edit_line("rig.toml", "extent_mm = [", "extent_mm = [-270, -200, -260, -190]");
    let out = rig.run_soon("calibrate", &[]);
    one_sentence(
        &out,
        &["lies outside of the image at every position", "[-270.0, -200.0, -260.0, -190.0]", "give its"],
    );
}

#[test]
fn files_that_end_too_early() {
    let rig = Rig::new();
    let depth = rig.scene_file("truth/depth.npy");
    let good = fs::read(&depth).unwrap();
    fs::write(&depth, &good[..5]).unwrap();
    check_finds(&rig, &["depth.npy: is no whole .npy file (it ends too early)"]);
    fs::write(&depth, "P").unwrap();
    let out = nelu3d(&["table", "info", depth.to_str().unwrap()]);
    one_sentence(&out, &["depth.npy", "(it ends too early)"]);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_is_named() {
    let rig = Rig::new();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let out = Command::new(env!("CARGO_BIN_EXE_nelu3d")).arg("check").arg(rig.at("")).arg("-q").stdout(full).output();
    one_sentence(&out.unwrap(), &["standard output: the answer cannot be written: No space left", "; free space"]);
}

/// The result is named, not the temporary file in the temporary folder.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_names_the_result() {
    let dir = tempfile::tempdir().unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "tmpfs"]).arg(dir.path()).output();
    if !mounted.is_ok_and(|m| m.status.success()) {
        eprintln!("SKIPPED: a_full_disk_names_the_result: mounting a small file system takes root");
        return;
    }
    let rig = Rig::new();
    let output = dir.path().join("results/ball");
    let out = rig.reconstruct(&["--effort", "quick", "-o", output.to_str().unwrap()]);
    let _ = Command::new("umount").arg(dir.path()).output();
    one_sentence(&out, &["results/ball/", ": cannot be written: No space left on device", "; free space on that disk"]);
    assert!(!stderr(&out).contains("partial"), "{}", stderr(&out));
}

#[test]
fn toml_errors_of_a_spec_are_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("spec.toml");
    for (text, says) in [("name = \"x\"\nseed = \"a\"\n", "line 2: invalid type: string \"a\""), ("a = [", "line 1: ")]
    {
        fs::write(&file, text).unwrap();
        let out = nelu3d(&["simulate", file.to_str().unwrap(), "-o", dir.path().join("rig").to_str().unwrap()]);
        one_sentence(&out, &["spec.toml: ", says, "; correct the file"]);
        assert!(!stderr(&out).contains('|') && !stderr(&out).contains('^'), "{}", stderr(&out));
    }
}

/// Neither digits by the hundred nor a damaged file's content.
#[test]
fn sentences_are_no_longer_than_people_read() {
    let rig = Rig::new();
    let text = fs::read_to_string(rig.at("camera.json")).unwrap();
    let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
    json["K"][0][0] = (-1e300).into();
    fs::write(rig.at("camera.json"), json.to_string()).unwrap();
    one_sentence(&rig.run_soon("calibrate", &[]), &["fx = -1e300; a focal length is positive"]);
    fs::write(rig.at("camera.json"), text).unwrap();
    fs::write(rig.scene_file("white.png"), long_tiff()).unwrap();
    let out = rig.reconstruct(&[]);
    one_sentence(&out, &["white.png: cannot be decoded ("]);
    assert!(stderr(&out).len() < 600, "{}", stderr(&out));
}

/// A TIFF whose width is a list of thousands of numbers, all of which its decoder would tell.
fn long_tiff() -> Vec<u8> {
    const N: u32 = 9000;
    let entry = |tag: u16, kind: u16, n: u32, value: u32| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &n.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let tags = [
        entry(256, 3, 1, 160),
        entry(257, 3, 1, 120),
        entry(258, 3, N, 200),
        entry(259, 3, 1, 1),
        entry(262, 3, 1, 1),
        entry(273, 4, 1, 8),
        entry(277, 3, N, 200),
        entry(278, 3, 1, 120),
        entry(279, 4, 1, 10),
    ];
    let mut file = [b"II*\0\x08\0\0\0", &(tags.len() as u16).to_le_bytes()[..], &tags.concat(), &[0; 4]].concat();
    file.resize(200, 0);
    file.extend([7, 3].repeat(N as usize));
    file
}

/// What a dependency thinks of a picture without a board is not for everybody.
#[test]
fn dependencies_do_not_warn() {
    // The detection of a board with markers in its squares is where it warns.
    let (_dir, rig) = super::common::simulated(&small("color"));
    let image = nelu3d_scan::Image { data: vec![0.5; 160 * 120 * 3], ..nelu3d_scan::Image::new(160, 120, 3) };
    for position in 0..10 {
        let file = rig.join(format!("calibration/{position:03}/white.png"));
        assert!(file.exists());
        nelu3d_scan::image::write_png16(&file, &image, 64.0, 4095.0).unwrap();
    }
    let out = nelu3d(&["calibrate", rig.to_str().unwrap(), "--quiet"]);
    one_sentence(&out, &["only 0 of 10 board positions are usable"]);
    assert!(!stderr(&out).contains("WARN"), "{}", stderr(&out));
}
