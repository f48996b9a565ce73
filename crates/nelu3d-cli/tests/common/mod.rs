//! What tests of the program share: how it is run, and virtual rigs to run it on.
#![allow(dead_code, reason = "no test uses all of it")]

use std::path::PathBuf;
use std::process::{Command, Output};

use nelu3d_sim::Spec;
use nelu3d_sim::spec::SweepSpec;

/// Runs the program.
pub(crate) fn nelu3d(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).output().expect("the program starts")
}

/// What it said on standard error.
pub(crate) fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// A rig in a temporary folder, which goes with the first value.
pub(crate) fn simulated(spec: &Spec) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("rig");
    nelu3d_sim::simulate(spec, &path, &|_, _, _| {}).expect("the spec is sound");
    (dir, path)
}

/// The same with the color field of its first pattern set.
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
