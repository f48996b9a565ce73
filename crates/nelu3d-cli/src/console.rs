//! What a person sees while the program works: bars on a terminal, plain lines elsewhere, always on standard error.

use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use nelu3d::progress::Sink;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

/// How often a stage that takes long says how far it is, where there is no terminal.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);

/// Shows progress, warnings and the log.
pub(crate) struct Console {
    quiet: bool,
    terminal: bool,
    stage: Mutex<Option<Stage>>,
}

struct Stage {
    name: String,
    start: Instant,
    last_line: Instant,
    bar: ProgressBar,
}

impl Console {
    /// A console; a quiet one shows only warnings.
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet, terminal: std::io::stderr().is_terminal(), stage: Mutex::new(None) }
    }

    /// Sends the log here: warnings, more with each `verbose`, or what NELU3D_LOG asks for.
    pub(crate) fn log(self: Arc<Self>, verbose: u8) {
        let level = [LevelFilter::WARN, LevelFilter::INFO, LevelFilter::DEBUG][usize::from(verbose.min(2))];
        // What libraries think of their input is for whoever asks: the program says itself what is wrong with it.
        let others = if verbose == 0 { LevelFilter::ERROR } else { level };
        let filter = Targets::new().with_default(others).with_target("nelu3d", level);
        // Levels by module. `EnvFilter` could filter by more, but brings a regular expression engine along.
        let asked = std::env::var("NELU3D_LOG").unwrap_or_default();
        let (filter, wrong) = match asked.parse::<Targets>() {
            _ if asked.trim().is_empty() => (filter, None),
            // A level for everything counts for everything; levels of modules add to the usual ones.
            Ok(asked) if asked.default_level().is_some() => (asked, None),
            Ok(asked) => (filter.with_targets(asked), None),
            Err(e) => (filter, Some(e)),
        };
        let ansi = self.terminal;
        let layer = tracing_subscriber::fmt::layer().with_ansi(ansi).with_target(verbose > 0).without_time();
        let layer = layer.with_writer(move || Lines(self.clone())).with_filter(filter);
        tracing_subscriber::registry().with(layer).init();
        if let Some(e) = wrong {
            tracing::warn!("NELU3D_LOG={asked}: {e}; write `debug`, or `nelu3d::reconstruct=debug,info`");
        }
    }

    /// Something good to know, in one line.
    pub(crate) fn note(&self, text: &str) {
        if !self.quiet {
            self.line(text);
        }
    }

    /// Tells a person what they have to know, quiet or not.
    pub(crate) fn say(&self, text: &str) {
        self.line(text);
    }

    /// Ends the last stage.
    pub(crate) fn finish(&self) {
        let stage = self.lock().take();
        self.end(stage, true);
    }

    /// Ends the last stage, which failed.
    pub(crate) fn abandon(&self) {
        let stage = self.lock().take();
        self.end(stage, false);
    }

    /// Prints a line between the bars.
    fn line(&self, text: &str) {
        match &*self.lock() {
            Some(stage) if self.terminal && !self.quiet => stage.bar.suspend(|| print(text)),
            _ => print(text),
        }
    }

    fn end(&self, stage: Option<Stage>, done: bool) {
        let Some(stage) = stage else { return };
        stage.bar.finish_and_clear();
        if done && !self.quiet {
            print(&format!("{:<46} {:>7.1} s", stage.name, stage.start.elapsed().as_secs_f64()));
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<Stage>> {
        // What a panicking thread left is still a fine bar.
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Sink for Console {
    fn stage(&self, name: &str) {
        // The line of the stage before is printed before the new bar draws itself.
        let before = self.lock().take();
        self.end(before, true);
        let bar = if self.terminal && !self.quiet {
            let bar = ProgressBar::new_spinner();
            bar.set_style(ProgressStyle::with_template("{spinner} {msg}").expect("a valid template"));
            bar.set_message(name.to_owned());
            bar.enable_steady_tick(Duration::from_millis(120));
            bar
        } else {
            ProgressBar::hidden()
        };
        let now = Instant::now();
        let stage = Stage { name: name.to_owned(), start: now, last_line: now, bar };
        *self.lock() = Some(stage);
    }

    fn tick(&self, done: usize, total: usize) {
        let mut guard = self.lock();
        let Some(stage) = guard.as_mut() else { return };
        if self.terminal {
            if stage.bar.length() != Some(total as u64) {
                let template = "{spinner} {msg:<46} {bar:24} {pos}/{len} {eta}";
                stage.bar.set_style(ProgressStyle::with_template(template).expect("a valid template"));
                stage.bar.set_length(total as u64);
            }
            stage.bar.set_position(done as u64);
        } else if !self.quiet && stage.last_line.elapsed() > PLAIN_INTERVAL {
            stage.last_line = Instant::now();
            print(&format!("{}: {done} of {total}", stage.name));
        }
    }

    fn warn(&self, message: &str) {
        self.line(&format!("warning: {message}"));
    }
}

/// Prints a line on standard error, which may have gone with its terminal: that is no reason to stop.
fn print(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Writes log lines through the console, so that they do not tear the bar.
struct Lines(Arc<Console>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.line(String::from_utf8_lossy(bytes).trim_end());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
