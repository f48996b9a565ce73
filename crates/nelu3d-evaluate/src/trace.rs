//! Error against time: how fast a reconstruction gets how good.

use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use nelu3d::reconstruct::{Observer, Stage};
use nelu3d_scan::Camera;

use crate::{EvaluatedMaps, GroundTruth, Regions, evaluate};

/// Records the error of every intermediate surface of a reconstruction against time. The time that this
/// takes is subtracted from the times it records.
pub struct Trace<'a> {
    truth: &'a GroundTruth,
    regions: Regions,
    camera: &'a Camera,
    /// When the trace began.
    #[doc(hidden)]
    pub wall: Instant,
    /// Time spent on evaluation.
    #[doc(hidden)]
    pub own_wall: Duration,
    own_cpu: Duration,
    points: Vec<TracePoint>,
}

/// The error of one intermediate surface. Errors are result − ground truth in mm, over the pixels that have a depth.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TracePoint {
    /// Stage that the surface comes from.
    pub stage: Stage,
    /// Iteration of the stage, from 1.
    pub iteration: usize,
    /// Processor time of the process since it started, all threads, s.
    pub cpu_secs: f64,
    /// Elapsed time since the trace began, s.
    pub wall_secs: f64,
    /// Fraction of the ground truth's pixels that have a depth.
    pub coverage: f64,
    /// Mean absolute error over the whole mask.
    pub mae: f64,
    /// Root mean square error over the whole mask.
    pub rmse: f64,
    /// Mean signed error over the whole mask.
    pub bias: f64,
    /// Median absolute error away from silhouettes and depth jumps.
    pub body_median: f64,
}

impl<'a> Trace<'a> {
    /// Starts a trace now.
    pub fn new(truth: &'a GroundTruth, camera: &'a Camera) -> Self {
        let (wall, cpu) = (Instant::now(), ProcessTime::now());
        let regions = truth.regions(camera);
        let mut trace = Self {
            truth,
            regions,
            camera,
            wall,
            own_wall: Duration::ZERO,
            own_cpu: Duration::ZERO,
            points: Vec::new(),
        };
        trace.subtract(wall, cpu);
        trace
    }

    /// Returns what was recorded, in order.
    pub fn points(self) -> Vec<TracePoint> {
        self.points
    }

    fn subtract(&mut self, wall: Instant, cpu: ProcessTime) {
        self.own_wall += wall.elapsed();
        self.own_cpu += cpu.elapsed();
    }
}

impl Observer for Trace<'_> {
    fn surface(&mut self, stage: Stage, iteration: usize, depth: &[f32]) {
        let (wall, cpu) = (Instant::now(), ProcessTime::now());
        let cpu_secs = cpu.as_duration().saturating_sub(self.own_cpu).as_secs_f64();
        let wall_secs = (wall - self.wall).saturating_sub(self.own_wall).as_secs_f64();
        let maps = EvaluatedMaps { depth, normals: None, sigma: None };
        let m = evaluate(&maps, self.truth, &self.regions, self.camera, None);
        let whole = m.whole.depth_mm;
        let body_median = m.body.depth_mm.median;
        let (mae, rmse, coverage) = (whole.mae, whole.rmse, m.whole.coverage);
        tracing::info!(?stage, iteration, cpu_secs, coverage, mae, rmse, body_median, "traced");
        self.points.push(TracePoint {
            stage,
            iteration,
            cpu_secs,
            wall_secs,
            coverage,
            mae,
            rmse,
            bias: whole.bias,
            body_median,
        });
        self.subtract(wall, cpu);
    }
}
