//! What tests of the program share: how it is run, and virtual rigs to run it on.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use nelu3d_sim::Spec;
use nelu3d_sim::spec::SweepSpec;

/// Runs the program.
pub(crate) fn nelu3d<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).output().expect("the program starts")
}

/// What it said on standard error.
pub(crate) fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// A Chromium, or `None` where there is none and that is allowed; says then which test is skipped.
pub(crate) fn chromium(skipped: &str) -> Option<PathBuf> {
    let found = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"].map(PathBuf::from);
    let found = std::env::var_os("CHROMIUM").map(PathBuf::from).or_else(|| found.into_iter().find(|p| p.is_file()));
    if found.is_none() {
        assert!(std::env::var_os("NELU3D_NEED_BROWSER").is_none_or(|v| v != "1"), "there is no Chromium");
        eprintln!("SKIPPED: there is no Chromium, so {skipped}");
    }
    found
}

/// The document of the page at an address after its scripts ran, in a window of a phone's width.
pub(crate) fn dom(chromium: &Path, address: &str) -> String {
    let profile = tempfile::tempdir().expect("a temporary folder");
    let out = Command::new(chromium)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic"])
        .args(["--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--window-size=390,800", "--virtual-time-budget=5000", "--timeout=60000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(address)
        .stderr(Stdio::null())
        .output()
        .expect("Chromium runs");
    assert!(out.status.success(), "Chromium failed: {}", out.status);
    String::from_utf8(out.stdout).expect("a document")
}

/// A rig in a temporary folder, which goes with the first value.
pub(crate) fn simulated(spec: &Spec) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("rig");
    nelu3d_sim::simulate(spec, &path, &|_, _, _| {}).expect("the spec is sound");
    (dir, path)
}

/// A rig with the color field of its first pattern set, in a temporary folder, which goes with the first value.
pub(crate) fn calibrated(spec: &Spec) -> (tempfile::TempDir, PathBuf) {
    let (dir, path) = simulated(spec);
    let out = nelu3d(&["calibrate", path.to_str().unwrap(), "--quiet"]);
    assert!(out.status.success(), "{}", stderr(&out));
    (dir, path)
}

/// A preset with a quarter of its pixels, ten board positions, and no scenes.
pub(crate) fn small(preset: &str) -> Spec {
    let mut spec = Spec::preset(preset).expect("a preset");
    let c = &mut spec.camera;
    (c.width, c.height) = (c.width / 2, c.height / 2);
    (c.fx, c.fy, c.cx, c.cy) = (0.5 * c.fx, 0.5 * c.fy, 0.5 * (c.cx - 0.5), 0.5 * (c.cy - 0.5));
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("the preset's board is on a stage") };
    *positions = 10;
    spec.scenes.clear();
    spec
}

/// A copy of a small calibrated rig with the scene `ball`, whose first pattern set is `two`: to be broken.
pub(crate) struct RigCopy {
    /// The folder that has it, as `rig`.
    pub(crate) dir: tempfile::TempDir,
}

impl RigCopy {
    /// Copies the rig, which is simulated and calibrated once for all tests of a program.
    pub(crate) fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        copy(&template().join("rig"), &dir.path().join("rig"));
        Self { dir }
    }

    /// Path of a file of the rig.
    pub(crate) fn at(&self, file: &str) -> PathBuf {
        self.dir.path().join("rig").join(file)
    }

    /// Runs a command with the arguments after the rig, quietly.
    pub(crate) fn run(&self, command: &str, rest: &[&str]) -> Output {
        let rig = self.at("");
        let mut args = vec![command, rig.to_str().unwrap(), "--quiet"];
        args.extend(rest);
        nelu3d(&args)
    }

    /// Replaces text in a file that has it once.
    pub(crate) fn edit(&self, file: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.at(file)).unwrap();
        assert_eq!(text.matches(from).count(), 1, "`{from}` in {text}");
        fs::write(self.at(file), text.replace(from, to)).unwrap();
    }
}

/// Simulates and calibrates what is copied. A static value is never dropped, so the folders of earlier runs are removed
/// here.
pub(crate) fn template() -> &'static Path {
    static TEMPLATE: OnceLock<tempfile::TempDir> = OnceLock::new();
    const PREFIX: &str = "small-rig-";
    const OLD: Duration = Duration::from_secs(3600);
    let dir = TEMPLATE.get_or_init(|| {
        let home = Path::new(env!("CARGO_TARGET_TMPDIR"));
        for old in fs::read_dir(home).unwrap().flatten() {
            let age = old.metadata().and_then(|m| m.modified()).ok().and_then(|t| t.elapsed().ok());
            if old.file_name().to_string_lossy().starts_with(PREFIX) && age.is_some_and(|a| a > OLD) {
                let _ = fs::remove_dir_all(old.path());
            }
        }
        let dir = tempfile::Builder::new().prefix(PREFIX).tempdir_in(home).unwrap();
        let spec: Spec = toml::from_str(include_str!("small.toml")).unwrap();
        let rig = dir.path().join("rig");
        nelu3d_sim::simulate(&spec, &rig, &|_, _, _| {}).expect("the spec is sound");
        let out = nelu3d(&["calibrate", rig.to_str().unwrap(), "--quiet"]);
        assert!(out.status.success(), "{}", stderr(&out));
        dir
    });
    dir.path()
}

/// Copies a folder with all that is in it.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() { copy(&path, &target) } else { _ = fs::copy(&path, &target).unwrap() }
    }
}
