//! A calibration from the positions so far, beside the capture: what `nelu3d calibrate` would say now.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use anyhow::{Context as _, Result, anyhow};
use nelu3d::verdict::Verdict;
use nelu3d::{CalibrationOptions, Progress, calibrate};
use nelu3d_scan::Rig;

use crate::context::HiddenSink;

/// Fewest positions that are tried: with fewer, what is held out is out of the others' reach.
pub(super) const MIN_POSITIONS: usize = 6;

/// What a calibration said.
#[derive(Clone, Debug)]
pub(super) struct TrialAnswer {
    /// Number of positions that it was made from.
    pub(super) positions: usize,
    /// Whether there is nothing to warn of.
    pub(super) is_good: bool,
    /// The verdict in words, and what to do.
    pub(super) text: String,
}

/// Calibrates a rig again and again in a thread of its own, as positions come. Nothing is written.
#[derive(Default)]
pub(super) struct Trial {
    running: Option<JoinHandle<TrialAnswer>>,
    stop: Arc<AtomicBool>,
    /// Positions of the last one that was begun.
    tried: usize,
}

impl Trial {
    /// Begins a calibration where there are enough positions, more than at the last one, and none is under way. Returns
    /// what an ended one said, once.
    pub(super) fn follow(&mut self, rig: &Path, positions: usize) -> Option<TrialAnswer> {
        let answer = self.running.take_if(|thread| thread.is_finished()).and_then(|thread| thread.join().ok());
        if self.running.is_none() && positions >= MIN_POSITIONS && positions > self.tried {
            self.tried = positions;
            let (rig, stop) = (rig.to_owned(), self.stop.clone());
            self.running = Some(std::thread::spawn(move || {
                attempt(&rig, stop).unwrap_or_else(|e| TrialAnswer {
                    positions,
                    is_good: false,
                    text: format!("no field yet: {e:#}"),
                })
            }));
        }
        answer
    }
}

impl Drop for Trial {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.running.take() {
            // It has nothing to say any more.
            let _ = thread.join();
        }
    }
}

fn attempt(rig: &Path, stop: Arc<AtomicBool>) -> Result<TrialAnswer> {
    // Half of the processors: the page, and perhaps its webcam, need the others.
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get().div_ceil(2));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().context("no threads to calibrate in")?;
    let rig = Rig::open(rig)?;
    let positions = rig.positions()?.len();
    let set = rig.pattern_set(None)?;
    let progress = Progress::new(Arc::new(HiddenSink), stop);
    let (_, report) = pool.install(|| calibrate(&rig, set, &CalibrationOptions::default(), &progress))?;
    let quality = report.quality.as_ref().ok_or_else(|| anyhow!("no position could be held out"))?;
    let judgment = &report.judgment;
    let mut text = format!(
        "field of {positions} positions: {}; held out {:.1} dB (noise alone: about {:.1} dB)",
        judgment.verdict, quality.psnr_db, quality.ceiling_db
    );
    if let Some(warning) = judgment.warnings.first() {
        text += &format!("; {}: {}", warning.sentence, warning.remedy);
    }
    Ok(TrialAnswer { positions, is_good: judgment.verdict == Verdict::Good, text })
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use nelu3d_sim::Spec;

    use super::*;

    #[test]
    fn positions_are_tried_as_they_come() {
        let dir = tempfile::tempdir().unwrap();
        let rig = dir.path().join("rig");
        let mut spec = Spec::preset("shapes").unwrap();
        spec.scenes.clear();
        spec.supersampling = 2;
        nelu3d_sim::simulate(&spec, &rig, &|_, _, _| {}).unwrap();
        let mut all: Vec<_> = std::fs::read_dir(rig.join("calibration")).unwrap().map(|f| f.unwrap().path()).collect();
        all.sort();
        let later = dir.path().join("later");
        std::fs::create_dir(&later).unwrap();
        // The nearest five first, then all of them.
        for place in &all[5..] {
            std::fs::rename(place, later.join(place.file_name().unwrap())).unwrap();
        }
        let mut trial = Trial::default();
        assert!(trial.follow(&rig, 5).is_none() && trial.running.is_none());
        for place in &all[5..] {
            std::fs::rename(later.join(place.file_name().unwrap()), place).unwrap();
        }
        let begun = Instant::now();
        let answer = loop {
            if let Some(answer) = trial.follow(&rig, all.len()) {
                break answer;
            }
            assert!(begun.elapsed() < Duration::from_secs(300), "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        };
        assert!(answer.is_good && answer.positions == all.len(), "{answer:?}");
        assert!(answer.text.contains(" positions: good; held out 3"), "{answer:?}");
        // Nothing new: nothing is done.
        assert!(trial.follow(&rig, all.len()).is_none() && trial.running.is_none());
        // What is wrong is said, and an end does not wait for it.
        std::fs::remove_file(rig.join("camera.json")).unwrap();
        let mut trial = Trial::default();
        trial.follow(&rig, 6);
        while !trial.running.as_ref().unwrap().is_finished() {
            std::thread::sleep(Duration::from_millis(20));
        }
        let answer = trial.follow(&rig, 6).unwrap();
        assert!(!answer.is_good && answer.text.contains("camera.json"), "{answer:?}");
    }
}
