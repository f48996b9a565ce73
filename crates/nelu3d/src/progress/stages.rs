//! Wall and CPU time of each stage.

use std::time::Instant;

use cpu_time::ProcessTime;

use super::sink::Progress;

/// The time that one stage took.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StageTime {
    /// Name of the stage.
    pub name: String,
    /// Elapsed time, s.
    pub wall_secs: f64,
    /// Processor time of the whole process, all threads, s.
    pub cpu_secs: f64,
}

/// Times the stages of a pipeline and announces them: `begin` ends the stage before it.
#[derive(Debug)]
pub struct StageClock<'a> {
    progress: &'a Progress,
    done: Vec<StageTime>,
    current: Option<Current>,
}

/// The stage that runs.
#[derive(Debug)]
struct Current {
    time: StageTime,
    /// Start of the running interval; `None` while the stage is paused.
    since: Option<(Instant, ProcessTime)>,
}

impl<'a> StageClock<'a> {
    /// Makes a clock that announces its stages to `progress`.
    pub fn new(progress: &'a Progress) -> Self {
        Self { progress, done: Vec::new(), current: None }
    }

    /// Begins a stage.
    pub fn begin(&mut self, name: &str) {
        self.end();
        self.progress.stage(name);
        self.current = Some(Current {
            time: StageTime { name: name.to_owned(), wall_secs: 0.0, cpu_secs: 0.0 },
            since: Some((Instant::now(), ProcessTime::now())),
        });
    }

    /// Stops counting: what follows, until [`Self::resume`] or the next stage, is no part of the work.
    pub fn pause(&mut self) {
        if let Some(Current { time, since }) = &mut self.current
            && let Some((wall, cpu)) = since.take()
        {
            time.wall_secs += wall.elapsed().as_secs_f64();
            time.cpu_secs += cpu.elapsed().as_secs_f64();
        }
    }

    /// Ends a pause.
    pub fn resume(&mut self) {
        if let Some(current) = &mut self.current {
            current.since.get_or_insert_with(|| (Instant::now(), ProcessTime::now()));
        }
    }

    /// Ends the current stage, if there is one.
    pub fn end(&mut self) {
        self.pause();
        self.done.extend(self.current.take().map(|c| c.time));
    }

    /// Ends the current stage and returns them all.
    pub fn finish(mut self) -> Vec<StageTime> {
        self.end();
        self.done
    }
}
