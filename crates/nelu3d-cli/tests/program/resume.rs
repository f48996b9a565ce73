//! Trainings that are killed or stopped and go on: recipe `paper` and TurboSL end with the very result of an
//! uninterrupted run, and a checkpoint of something else is refused.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use std::{fs, thread};

use serde_json::Value;

use super::common::{RigCopy, nelu3d, stderr};

/// Arguments of the trainings, small ones.
const PAPER: &[&str] = &["reconstruct", "--recipe", "paper", "--start", "plane", "--device", "cpu"];
const TURBOSL: &[&str] = &["decode", "--method", "turbosl"];
const SMALL: &[&str] = &["--steps", "30", "--samples", "1024", "--checkpoint-every", "5", "--quiet"];

/// A training on a rig, and where its checkpoint lies.
struct Training<'a> {
    rig: &'a RigCopy,
    args: &'a [&'a str],
}

impl Training<'_> {
    fn path(&self, name: &str) -> String {
        self.rig.dir.path().join(name).to_str().unwrap().to_owned()
    }

    /// Arguments of a run into the folder `result`, with a checkpoint or without.
    fn arguments(&self, result: &str, checkpoint: Option<&str>, more: &[&str]) -> Vec<String> {
        let mut all = vec![self.args[0].to_owned(), self.path("rig"), "ball".into(), "-o".into(), self.path(result)];
        let rest = self.args[1..].iter().chain(SMALL).chain(more);
        all.extend(rest.map(|a| (*a).to_owned()));
        all.extend(checkpoint.map(|name| format!("--checkpoint={}", self.path(name))));
        all
    }

    /// Starts a run and kills it as soon as its checkpoint is there.
    fn kill(&self, checkpoint: &str) {
        let args = self.arguments("killed", Some(checkpoint), &[]);
        let mut child = Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).stderr(Stdio::null()).spawn().unwrap();
        let begun = Instant::now();
        while !Path::new(&self.path(checkpoint)).exists() {
            assert!(begun.elapsed() < Duration::from_secs(300) && child.try_wait().unwrap().is_none());
            thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!Path::new(&self.path("killed")).exists(), "it was done before it was killed");
        assert!(Path::new(&self.path(checkpoint)).exists());
    }

    /// Returns the message of a run that is refused.
    fn refusal(&self, checkpoint: &str, more: &[&str]) -> String {
        let out = nelu3d(&self.arguments("refused", Some(checkpoint), more));
        assert!(!out.status.success() && !Path::new(&self.path("refused")).exists());
        stderr(&out)
    }

    /// Kills and resumes a run, and compares it with a whole one.
    fn check(&self) {
        let whole = nelu3d(&self.arguments("whole", None, &[]));
        assert!(whole.status.success(), "{}", stderr(&whole));
        self.kill("state");

        // A checkpoint of other settings, of another scene, and a damaged one.
        let said = self.refusal("state", &["--seed", "5"]);
        assert!(said.contains("other settings") && said.trim_end().lines().count() == 1, "{said}");
        let (one, other) = (self.rig.at("scenes/ball/sine_00.png"), self.rig.at("scenes/ball/triangle_00.png"));
        let images = [&one, &other].map(|path| fs::read(path).unwrap());
        fs::write(&one, &images[1]).unwrap();
        fs::write(&other, &images[0]).unwrap();
        let said = self.refusal("state", &[]);
        assert!(said.contains("another scene") && said.trim_end().lines().count() == 1, "{said}");
        fs::write(&one, &images[0]).unwrap();
        fs::write(&other, &images[1]).unwrap();
        let mut bytes = fs::read(self.path("state")).unwrap();
        fs::write(self.path("short"), &bytes[..bytes.len() / 2]).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(self.path("changed"), &bytes).unwrap();
        for damaged in ["short", "changed"] {
            let said = self.refusal(damaged, &[]);
            assert!(said.contains("no whole checkpoint") && said.trim_end().lines().count() == 1, "{said}");
        }

        let resumed = nelu3d(&self.arguments("resumed", Some("state"), &["--threads", "1"]));
        assert!(resumed.status.success(), "{}", stderr(&resumed));
        for map in ["depth.npy", "normals.npy", "sigma.npy", "mesh.ply"] {
            let read = |result: &str| fs::read(Path::new(&self.path(result)).join(map)).unwrap();
            assert!(read("whole") == read("resumed"), "{map} differs");
        }
        let losses = |result: &str| {
            let text = fs::read_to_string(Path::new(&self.path(result)).join("result.json")).unwrap();
            find(&serde_json::from_str(&text).unwrap(), "losses").expect("the training's record").to_string()
        };
        assert_eq!(losses("whole"), losses("resumed"));
        // It is of no use any more.
        assert!(!Path::new(&self.path("state")).exists());
    }
}

/// Returns the value of a key, wherever it is.
fn find<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    let object = value.as_object()?;
    object.get(key).or_else(|| object.values().find_map(|v| find(v, key)))
}

#[test]
fn a_killed_training_of_recipe_paper_goes_on() {
    Training { rig: &RigCopy::new(), args: PAPER }.check();
}

#[test]
fn a_training_of_turbosl_that_was_stopped_goes_on() {
    // One that was to stop early goes on like one that was killed: with the schedule of all iterations.
    let training = Training { rig: &RigCopy::new(), args: TURBOSL };
    let run = |result, checkpoint, more: &[&str]| {
        let out = nelu3d(&training.arguments(result, checkpoint, more));
        assert!(out.status.success(), "{}", stderr(&out));
        fs::read(Path::new(&training.path(result)).join("depth.npy")).unwrap()
    };
    let whole = run("whole", None, &[]);
    let part = run("part", Some("state"), &["--stop-after", "15"]);
    let continued = run("continued", Some("state"), &["--threads", "1"]);
    assert!(whole == continued && whole != part);
}
