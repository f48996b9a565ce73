//! Ctrl-C, and the signals by which schedulers and closing terminals end a program: the first asks the work to stop at
//! its next chance, the second ends the program on the spot. Either way nothing half written stays behind.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};

/// Number of SIGHUP on every Unix: the terminal has gone.
const HANGUP: i32 = 1;
/// Number of SIGINT on every Unix: Ctrl-C.
const INTERRUPT: i32 = 2;
/// Number of SIGTERM on every Unix: what `kill`, Slurm and a machine that shuts down send.
const TERMINATE: i32 = 15;

/// Whether work should stop, and why.
#[derive(Clone)]
pub(crate) struct StopRequest {
    /// Set once work should stop.
    pub requested: Arc<AtomicBool>,
    signal: Arc<AtomicI32>,
}

impl StopRequest {
    /// Starts to listen.
    ///
    /// # Errors
    ///
    /// The system refuses.
    pub(crate) fn listen() -> io::Result<Self> {
        let stop = Self { requested: Arc::default(), signal: Arc::default() };
        stop.clone().listen_on_its_own()?;
        Ok(stop)
    }

    /// Returns the exit code of a program that was stopped: 1 after Ctrl-C; 128 and the signal's number, as shells count,
    /// after the others.
    pub(crate) fn exit_code(&self) -> u8 {
        exit_code(self.signal.load(Ordering::Relaxed))
    }

    #[cfg(unix)]
    fn listen_on_its_own(self) -> io::Result<()> {
        let mut wanted = vec![INTERRUPT, TERMINATE];
        wanted.extend((!is_hangup_ignored()).then_some(HANGUP));
        let mut signals = signal_hook::iterator::Signals::new(&wanted)?;
        std::thread::Builder::new()
            .name("signals".into())
            .spawn(move || signals.forever().for_each(|signal| self.received(signal)))?;
        Ok(())
    }

    #[cfg(not(unix))]
    fn listen_on_its_own(self) -> io::Result<()> {
        ctrlc::set_handler(move || self.received(INTERRUPT)).map_err(io::Error::other)
    }

    fn received(&self, signal: i32) {
        self.signal.store(signal, Ordering::Relaxed);
        if self.requested.swap(true, Ordering::Relaxed) {
            nelu3d_scan::output::remove_partial();
            std::process::exit(i32::from(exit_code(signal)));
        }
        let why = match signal {
            HANGUP => "the terminal has gone",
            TERMINATE => "asked to end; a second time ends it at once",
            _ => "Ctrl-C again to stop at once",
        };
        // The terminal may have gone.
        let _ = writeln!(io::stderr(), "\nstopping ({why})");
    }
}

fn exit_code(signal: i32) -> u8 {
    match signal {
        HANGUP | TERMINATE => 128 + signal as u8,
        _ => 1,
    }
}

/// Returns whether this program was started to outlive its terminal, as `nohup` does.
#[cfg(target_os = "linux")]
fn is_hangup_ignored() -> bool {
    let ignored = |status: String| {
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        Some(u64::from_str_radix(mask.trim(), 16).ok()? >> (HANGUP - 1) & 1 == 1)
    };
    std::fs::read_to_string("/proc/self/status").ok().and_then(ignored).unwrap_or(false)
}

/// Elsewhere nobody tells without unsafe code, so that the signal is left as it is: `nohup` must go on working.
#[cfg(all(unix, not(target_os = "linux")))]
fn is_hangup_ignored() -> bool {
    true
}
