//! Wall and CPU time of each stage.

use std::time::Instant;

use cpu_time::ProcessTime;

use crate::progress::Progress;

/// How long one stage took.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StageTime {
    /// Its name.
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
    current: Option<(String, Instant, ProcessTime)>,
}

impl<'a> StageClock<'a> {
    /// A clock that announces its stages to `progress`.
    pub fn new(progress: &'a Progress) -> Self {
        Self { progress, done: Vec::new(), current: None }
    }

    /// Begins a stage.
    pub fn begin(&mut self, name: &str) {
        self.end();
        self.progress.stage(name);
        self.current = Some((name.to_owned(), Instant::now(), ProcessTime::now()));
    }

    /// Ends the current stage, if there is one.
    pub fn end(&mut self) {
        if let Some((name, wall, cpu)) = self.current.take() {
            let (wall_secs, cpu_secs) = (wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64());
            self.done.push(StageTime { name, wall_secs, cpu_secs });
        }
    }

    /// Ends the current stage and returns them all.
    pub fn finish(mut self) -> Vec<StageTime> {
        self.end();
        self.done
    }
}
