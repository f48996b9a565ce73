//! Cameras whose frames are files: a program that is run for each, or a folder that another program fills.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nelu3d_scan::image::{Raw, decode};

use crate::camera::{Camera, CameraPace};
use crate::error::CaptureError;
use crate::frame::Frame;

/// Longest time that a frame may take.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time between two looks at a folder or a running program.
const POLL: Duration = Duration::from_millis(10);

/// A camera that takes a picture when a program is run, as `gphoto2 --capture-image-and-download --filename {file}`.
#[derive(Debug)]
pub struct CommandCamera {
    command: String,
    folder: PathBuf,
    clock: Instant,
    stop: Arc<AtomicBool>,
    frames: u64,
}

impl CommandCamera {
    /// Returns a camera that runs `command` in the system's shell, with `{file}` replaced by where the picture has to
    /// be written: a PNG, TIFF or OpenEXR file in `folder`, which it removes again. `clock` is the display's; `stop`
    /// ends the waiting.
    ///
    /// # Errors
    ///
    /// The command has no `{file}`.
    pub fn new(command: &str, folder: &Path, clock: Instant, stop: Arc<AtomicBool>) -> Result<Self, CaptureError> {
        Self::check(command)?;
        Ok(Self { command: command.into(), folder: folder.to_path_buf(), clock, stop, frames: 0 })
    }

    /// Checks a command without running it.
    ///
    /// # Errors
    ///
    /// The command has no `{file}`.
    pub fn check(command: &str) -> Result<(), CaptureError> {
        if command.contains("{file}") {
            return Ok(());
        }
        Err(CaptureError::Device {
            device: "the camera's command".into(),
            problem: "does not say where the picture goes".into(),
            remedy: "write {file} where the name of the file belongs".into(),
        })
    }

    fn fails(&self, problem: String, remedy: &str) -> CaptureError {
        CaptureError::Device { device: format!("`{}`", self.command), problem, remedy: remedy.into() }
    }

    fn run(&self, file: &Path) -> Result<(), CaptureError> {
        let typed = self.command.replace("{file}", &file.to_string_lossy());
        let mut shell = if cfg!(windows) { Command::new("cmd") } else { Command::new("sh") };
        shell.args([if cfg!(windows) { "/C" } else { "-c" }, typed.as_str()]);
        let remedy = "run it by hand to see why";
        let spawned = shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let mut child = spawned.map_err(|e| self.fails(format!("cannot be run: {e}"), remedy))?;
        let begun = Instant::now();
        loop {
            match child.try_wait() {
                Ok(Some(status)) if status.success() => return Ok(()),
                Ok(Some(status)) => return Err(self.fails(format!("failed ({status})"), remedy)),
                Err(e) => return Err(self.fails(format!("cannot be waited for: {e}"), remedy)),
                Ok(None) => {}
            }
            let stopped = self.stop.load(Ordering::Relaxed);
            if stopped || begun.elapsed() > PATIENCE {
                // It may have ended by itself meanwhile.
                let _ = child.kill();
                let _ = child.wait();
                if stopped {
                    return Err(CaptureError::Stopped);
                }
                return Err(self.fails(format!("took longer than {} s", PATIENCE.as_secs()), remedy));
            }
            std::thread::sleep(POLL);
        }
    }
}

impl Camera for CommandCamera {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let file = self.folder.join(format!("frame-{}.png", self.frames));
        self.run(&file)?;
        let at = self.clock.elapsed();
        if !file.exists() {
            let problem = format!("wrote no {}", file.display());
            return Err(self.fails(problem, "see that {file} is the name of its output"));
        }
        let raw = decode(&file, None)?;
        std::fs::remove_file(&file)?;
        self.frames += 1;
        Ok(Frame { number: self.frames - 1, at, raw })
    }

    fn pace(&self) -> CameraPace {
        CameraPace::OnRequest
    }
}

/// A folder into which another program puts the camera's pictures, one after the other: PNG, TIFF or OpenEXR. What is
/// in it at first is not looked at, and nothing is removed.
#[derive(Debug)]
pub struct WatchedFolder {
    folder: PathBuf,
    seen: HashSet<PathBuf>,
    clock: Instant,
    stop: Arc<AtomicBool>,
    frames: u64,
}

impl WatchedFolder {
    /// Returns a camera whose frames are the files that come to be in `folder` from now on. `clock` is the display's;
    /// `stop` ends the waiting.
    ///
    /// # Errors
    ///
    /// The folder cannot be listed.
    pub fn new(folder: &Path, clock: Instant, stop: Arc<AtomicBool>) -> Result<Self, CaptureError> {
        let mut watched = Self { folder: folder.to_path_buf(), seen: HashSet::new(), clock, stop, frames: 0 };
        watched.seen = watched.files()?.into_iter().collect();
        Ok(watched)
    }

    /// The pictures in the folder, in the order of their names.
    fn files(&self) -> Result<Vec<PathBuf>, CaptureError> {
        let fails = |e: std::io::Error| CaptureError::Unfit {
            path: self.folder.clone(),
            problem: format!("cannot be listed: {e}"),
            remedy: "give the folder that the camera's pictures go to".into(),
        };
        let mut all = Vec::new();
        for entry in std::fs::read_dir(&self.folder).map_err(fails)? {
            let path = entry.map_err(fails)?.path();
            let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            let is_hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
            if !is_hidden && ["png", "tif", "tiff", "exr", "jpg", "jpeg"].contains(&ending.as_str()) {
                all.push(path);
            }
        }
        all.sort();
        Ok(all)
    }

    /// Reads a file that may still be under way: it is there when it can be decoded, and its size rests.
    fn read(&self, file: &Path) -> Result<Raw, CaptureError> {
        let begun = Instant::now();
        let size = || std::fs::metadata(file).map(|m| m.len()).unwrap_or(0);
        loop {
            let before = size();
            std::thread::sleep(POLL);
            let found = decode(file, None);
            match found {
                Ok(raw) if size() == before => return Ok(raw),
                Err(e) if begun.elapsed() > Duration::from_secs(5) => return Err(e.into()),
                _ => {}
            }
        }
    }
}

impl Camera for WatchedFolder {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let begun = Instant::now();
        loop {
            let new = self.files()?.into_iter().find(|f| !self.seen.contains(f));
            if let Some(file) = new {
                let at = self.clock.elapsed();
                let raw = self.read(&file)?;
                self.seen.insert(file);
                self.frames += 1;
                return Ok(Frame { number: self.frames - 1, at, raw });
            }
            if self.stop.load(Ordering::Relaxed) {
                return Err(CaptureError::Stopped);
            }
            if begun.elapsed() > PATIENCE {
                return Err(CaptureError::Device {
                    device: self.folder.display().to_string(),
                    problem: format!("no picture came for {} s", PATIENCE.as_secs()),
                    remedy: "see that the camera's program saves there".into(),
                });
            }
            std::thread::sleep(POLL);
        }
    }

    fn pace(&self) -> CameraPace {
        CameraPace::Sparse
    }
}
