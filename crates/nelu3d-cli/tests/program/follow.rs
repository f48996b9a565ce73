//! `nelu3d sequence --follow`: frames are seen while they arrive, late and broken ones stop nothing, and in the end all
//! are computed as if nobody had looked.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::common::{chromium, dom};
use super::sequence::{content, rig, whole};

/// A running program; it does not outlive its test.
struct Follower {
    child: Child,
    /// Host, port, and path of its page.
    host: String,
    path: String,
}

impl Drop for Follower {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Follower {
    fn start(frames: &Path, out: &Path, idle: &str) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_nelu3d"))
            .args(["sequence", rig().to_str().unwrap(), frames.to_str().unwrap(), "--follow", "--idle", idle])
            .args(["-o", out.to_str().unwrap(), "--keyframe", "3", "--quiet", "--json"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        let line = said.find(|line| line.contains("http://")).expect("it says where its page is");
        // Nobody may leave the pipe full.
        std::thread::spawn(move || said.for_each(drop));
        let address = line.split("http://").nth(1).unwrap().split(' ').next().unwrap();
        let (host, path) = address.split_once('/').unwrap();
        Self { child, host: host.into(), path: format!("/{path}") }
    }

    /// Asks for something below the page's address; returns status and content.
    fn get(&self, what: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        // In HTTP 1.0 answers come in one piece.
        write!(stream, "GET {}{what} HTTP/1.0\r\nHost: {}\r\n\r\n", self.path, self.host).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), body.into())
    }

    /// Returns the surfaces that are published from now until one of this frame and stage is.
    fn until(&self, frame: &str, stage: &str, after: &mut u64) -> Vec<Value> {
        let begun = Instant::now();
        let mut seen: Vec<Value> = Vec::new();
        while begun.elapsed() < Duration::from_secs(60) {
            let (status, body) = self.get(&format!("surface?after={after}"));
            assert_eq!(
                status,
                200,
                "the program waits no longer; frame {frame} was not {stage}, but {:?}",
                stages(&seen)
            );
            let answer: Value = serde_json::from_str(&body).unwrap();
            *after = answer["published"].as_u64().unwrap();
            let surface = answer["surface"].clone();
            let is_it = surface["frame"] == frame && surface["stage"] == stage;
            if !surface.is_null() {
                seen.push(surface);
            }
            if is_it {
                return seen;
            }
        }
        panic!("frame {frame} was not {stage}, but {:?}", stages(&seen));
    }
}

fn stages(seen: &[Value]) -> Vec<String> {
    seen.iter().map(|s| format!("{} {}", s["frame"].as_str().unwrap(), s["stage"].as_str().unwrap())).collect()
}

/// Puts a frame of the rig's sequence into a folder at once.
fn arrive(frames: &Path, name: &str) {
    let (from, hidden) = (rig().join("sequences/ball").join(name), frames.join(format!(".{name}")));
    std::fs::create_dir_all(&hidden).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap).filter(|e| e.path().is_file()) {
        std::fs::copy(entry.path(), hidden.join(entry.file_name())).unwrap();
    }
    std::fs::rename(hidden, frames.join(name)).unwrap();
}

#[test]
fn frames_are_shown_as_they_arrive_and_all_are_computed_in_the_end() {
    let dir = tempfile::tempdir().unwrap();
    let (frames, out) = (dir.path().join("ball"), dir.path().join("out"));
    // Long enough for a busy machine to stop for seconds between two lines of this test.
    let mut program = Follower::start(&frames, &out, "8");
    let (_, page) = program.get("");
    assert!(page.contains("<h1>ball</h1>"), "{page}");
    for file in ["style.css", "viewer.js", "live.js"] {
        assert_eq!(program.get(file).0, 200, "{file}");
    }
    assert_eq!((program.get("rig.toml").0, program.get("../").0), (404, 404));

    // There was no folder yet. While nothing newer comes, the surface is refined.
    let mut after = 0;
    arrive(&frames, "000");
    let seen = program.until("000", "refined", &mut after);
    assert!(seen.last().unwrap()["mesh"]["vertices"].as_u64().unwrap() > 500, "{:?}", stages(&seen));
    // The newest frame is shown; the one before it is left out, though it arrives later.
    arrive(&frames, "002");
    arrive(&frames, "001");
    let seen = program.until("002", "first", &mut after);
    assert!(stages(&seen).iter().all(|s| s.starts_with("002")), "{:?}", stages(&seen));
    // A broken frame says so, and the next one goes on.
    let broken = frames.join("003/white.png");
    arrive(&frames, "003");
    let good = std::fs::read(&broken).unwrap();
    std::fs::write(&broken, &good[..good.len() / 2]).unwrap();
    let seen = program.until("003", "failed", &mut after);
    let message = seen.last().unwrap()["message"].as_str().unwrap().to_owned();
    assert!(message.contains("003") && message.contains("white.png"), "{message}");
    std::fs::write(&broken, &good).unwrap();
    arrive(&frames, "004");
    let seen = program.until("004", "refined", &mut after);
    assert!(seen.last().unwrap()["mesh"]["vertices"].as_u64().unwrap() > 500, "{:?}", stages(&seen));

    // No more frames: all of them are computed and written, as without anybody looking.
    let mut answer = String::new();
    program.child.stdout.take().unwrap().read_to_string(&mut answer).unwrap();
    assert!(program.child.wait().unwrap().success());
    let answer: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((answer["done"].as_u64(), answer["complete"].as_bool()), (Some(5), Some(true)));
    assert!(content(&out) == content(&whole().0.path().join("out")), "the results differ");
}

#[test]
fn the_moving_surface_is_drawn_in_a_browser() {
    let Some(chromium) = chromium("no moving surface was drawn") else { return };
    let dir = tempfile::tempdir().unwrap();
    let (frames, out) = (dir.path().join("ball"), dir.path().join("out"));
    ["000", "001"].iter().for_each(|name| arrive(&frames, name));
    // Its end ends what the page waits for.
    let program = Follower::start(&frames, &out, "8");
    let dom = dom(&chromium, &format!("http://{}{}", program.host, program.path));
    assert!(dom.contains("data-drawn=\"yes\"") && dom.contains("data-surfaces=\""), "{dom}");
    assert!(dom.contains("<b data-live-frame=\"\">001</b>"), "{dom}");
}
